"""Where the time of an update goes: the calls of the pipeline, timed from outside.

The one place that knows which calls those are; segmenter.py stays free of clocks.
"""

import functools
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from ellipseg_ros import segmenter
from ellipseg_ros.core.merge import Merge
from ellipseg_ros.core.neighbours import Neighbours
from ellipseg_ros.core.tracking import Tracker
from ellipseg_ros.core.window import Window
from ellipseg_ros.segmenter import Segmenter

OTHER = "the rest"  # what `process` does itself
STAGES: list[tuple[str, Any, str]] = [  # stage, owner of the call, its name there
    ("window", Window, "push"),
    ("neighbours", Neighbours, "update"),
    ("ellipsoids", segmenter, "initial_ellipsoids"),
    ("ellipsoids", segmenter, "neighbour_masses"),
    ("edges", segmenter, "update_edges"),
    ("merge", Merge, "widened"),
    ("merge", Merge, "update"),
    ("renumbering", Segmenter, "_make_room"),
    ("ids", Tracker, "assign"),
    ("objects", Segmenter, "_objects"),
    ("landmarks", Segmenter, "_landmarks"),
    ("result", Segmenter, "_result"),
    (OTHER, Segmenter, "process"),
]
NAMES = tuple(dict.fromkeys(name for name, _, _ in STAGES))


class Clock:
    """Seconds of every stage, its own without those of calls within it."""

    def __init__(self) -> None:
        self.seconds = dict.fromkeys(NAMES, 0.0)
        self._inner = [0.0]  # seconds of the calls within the one that runs, by depth

    def around(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        """The same call, its time noted."""

        @functools.wraps(call)
        def timed(*args: Any, **kwargs: Any) -> Any:
            self._inner.append(0.0)
            start = time.perf_counter()
            try:
                return call(*args, **kwargs)
            finally:
                took = time.perf_counter() - start
                self.seconds[name] += took - self._inner.pop()
                self._inner[-1] += took

        return timed


@contextmanager
def watched() -> Iterator[Clock]:
    """Time the stages of everything that is segmented in this block."""
    clock = Clock()
    originals = [(owner, call, getattr(owner, call)) for _, owner, call in STAGES]
    for name, owner, call in STAGES:
        setattr(owner, call, clock.around(name, getattr(owner, call)))
    try:
        yield clock
    finally:
        for owner, call, original in originals:
            setattr(owner, call, original)
