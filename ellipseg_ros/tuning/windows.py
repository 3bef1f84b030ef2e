"""Windows of sources, for tuning."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

from ellipseg_ros.config import Config
from ellipseg_ros.core.window import Window
from ellipseg_ros.node.grouping import updates
from ellipseg_ros.records import SECOND, Array, Sweep

MIN_STEP_SHARE = 0.5  # a remainder at the end shorter than this share of a step is no window


@dataclass(frozen=True)
class Cut:
    """The points of one window of a source."""

    source: str
    number: int  # of the window in its source, from 0
    start_s: float  # s of sensor time from the source's first point to the window's first
    end_s: float  # and to its last
    points: Array  # (n, 3) m: the accepted ones
    origin: Array  # (3,) m: see Segmentation


def windows(
    source: str, sweeps: Iterable[Sweep], config: Config, every: float | None = None
) -> Iterator[Cut]:
    """Yield windows of `config.window_duration`, one every `every` s; by default end to end.

    A source shorter than a window, such as a single cloud, is one window; so is the remainder at
    the end of a source or before a restart, if it is at least half as long as a step.
    """
    step = every or config.window_duration
    config = replace(config, update_period=step)
    window, number = Window(), 0
    first_ns: int | None = None  # of the source
    cut_ns: int | None = None  # where the last window since a restart ended
    for group in updates(sweeps, config):
        if group.restart:
            window, cut_ns = Window(), None
        window.push(group, config)
        if first_ns is None:
            first_ns = int(group.times_ns.min(initial=window.end_ns))
        begin_ns = int(window.points.times_ns.min(initial=window.end_ns))
        if cut_ns is not None and window.end_ns - cut_ns < MIN_STEP_SHARE * step * SECOND:
            continue
        points = window.points.position[window.accepted]
        span = ((begin_ns - first_ns) / SECOND, (window.end_ns - first_ns) / SECOND)
        yield Cut(source, number, *span, points, window.origin)
        number, cut_ns = number + 1, window.end_ns
