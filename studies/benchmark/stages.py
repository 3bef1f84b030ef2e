"""Time of the stages of an update, measured by wrapping the calls of the pipeline.

The only place that knows these calls; the pipeline itself reads no clock.
"""

import functools
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from ellipseg_ros import segmenter
from ellipseg_ros.core import graph, merge
from ellipseg_ros.core.graph import Graph
from ellipseg_ros.core.merge import Merge
from ellipseg_ros.core.segments import SegmentStage
from ellipseg_ros.core.tracking import Tracker
from ellipseg_ros.core.window import Window
from ellipseg_ros.landmarks.stage import LandmarkStage
from ellipseg_ros.objects.stage import ObjectStage
from ellipseg_ros.segmenter import Segmenter

OTHER = "other"  # time of `process` outside the other stages
STAGES: list[tuple[str, Any, str]] = [  # stage, class or module, name of the call in it
    ("window", Window, "push"),
    ("neighbours", Graph, "update"),
    ("ellipsoids", graph, "initial_ellipsoids"),
    ("ellipsoids", merge, "initial_values"),
    ("edges", graph, "update_edges"),
    ("renumbering", graph, "moved"),
    ("renumbering", merge, "renumber_dendrogram"),
    ("merge", Merge, "update"),
    ("ids", Tracker, "assign"),
    ("segments", SegmentStage, "update"),
    ("adjacency", segmenter, "segment_adjacency"),
    ("objects", ObjectStage, "update"),
    ("landmarks", LandmarkStage, "update"),
    (OTHER, Segmenter, "process"),
]
NAMES = tuple(dict.fromkeys(name for name, _, _ in STAGES))


class StageClock:
    """Accumulates the seconds of every stage; those of nested calls count for the inner one."""

    def __init__(self) -> None:
        self.seconds = dict.fromkeys(NAMES, 0.0)
        self._nested = [0.0]  # seconds of the calls within each call that is running

    def wrap(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        """`call`, with its time added to the stage `name`."""

        @functools.wraps(call)
        def timed(*args: Any, **kwargs: Any) -> Any:
            self._nested.append(0.0)
            start = time.perf_counter()
            try:
                return call(*args, **kwargs)
            finally:
                elapsed = time.perf_counter() - start
                self.seconds[name] += elapsed - self._nested.pop()
                self._nested[-1] += elapsed

        return timed


@contextmanager
def stage_clock() -> Iterator[StageClock]:
    """Time the stages of every update in this block."""
    clock = StageClock()
    originals = [(owner, call, getattr(owner, call)) for _, owner, call in STAGES]
    for name, owner, call in STAGES:
        setattr(owner, call, clock.wrap(name, getattr(owner, call)))
    try:
        yield clock
    finally:
        for owner, call, original in originals:
            setattr(owner, call, original)
