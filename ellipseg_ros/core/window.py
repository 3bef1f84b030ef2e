"""The points of the last seconds: arrivals, expiries, and who takes part."""

from dataclasses import dataclass

import numpy as np

from ellipseg_ros.config import Config
from ellipseg_ros.data import REJECTED, THINNED, Array, Sweep, join_fields

SECOND = 1_000_000_000  # ns
LARGEST = 1e8  # m: a coordinate beyond is no measurement (the Earth's radius is 6.4e6 m)
TAKES_PART = 0  # fate of a point that has not been rejected or thinned
WEYL = np.uint64(0x9E3779B97F4A7C15)  # 2^64 / golden ratio: multiples are spread evenly


@dataclass(frozen=True)
class Window:
    """The points with start_ns < t <= end_ns, in the order of arrival; row i is point i."""

    points: Array  # (n, 3) float64, m, world frame, as they came
    times_ns: Array  # (n,) int64
    arrival: Array  # (n,) int64: serial number since the last reset
    fate: Array  # (n,) int8: TAKES_PART, REJECTED or THINNED
    fields: Array | None  # (n,) structured
    frame_id: str
    start_ns: int
    end_ns: int
    arrived: int  # points since the last reset
    origin: Array | None  # (3,) m: whole kilometres; None until a point has taken part

    @property
    def local(self) -> Array:
        """(m, 3) float64, m: the points that take part, about the origin."""
        if self.origin is None:
            return np.zeros((0, 3))
        local: Array = self.points[self.fate == TAKES_PART] - self.origin
        return local


def push(
    window: Window | None, sweep: Sweep, config: Config, origin: Array | None = None
) -> Window:
    """The window that ends with the newest point of `sweep`, or where it ended, if that is later.

    window: the one before, None after a reset. origin: (3,) m, else from the first cloud.
    """
    times = sweep.times_ns
    ends = [int(times.max())] if len(times) else []
    ends += [window.end_ns] if window is not None else []
    end = max(ends, default=sweep.stamp_ns)
    start = end - round(config.window_duration * SECOND)
    arrived = 0 if window is None else window.arrived
    fate = _fate(sweep, arrived, _budget(times, window, config))
    if window is not None and window.origin is not None:
        origin = window.origin
    if origin is None:
        origin = _origin(sweep.points[fate == TAKES_PART])
    new = Window(
        sweep.points,
        times,
        np.arange(arrived, arrived + len(times)),
        fate,
        sweep.fields,
        sweep.frame_id,
        start,
        end,
        arrived + len(times),
        origin,
    )
    return _cut(new) if window is None else _joined(_cut(window, start), _cut(new))


def _cut(window: Window, start_ns: int | None = None) -> Window:
    """Without the points that have expired."""
    start = window.start_ns if start_ns is None else start_ns
    stays = window.times_ns > start
    if stays.all():
        return window
    return Window(
        window.points[stays],
        window.times_ns[stays],
        window.arrival[stays],
        window.fate[stays],
        None if window.fields is None else window.fields[stays],
        window.frame_id,
        start,
        window.end_ns,
        window.arrived,
        window.origin,
    )


def _joined(old: Window, new: Window) -> Window:
    return Window(
        np.concatenate([old.points, new.points]),
        np.concatenate([old.times_ns, new.times_ns]),
        np.concatenate([old.arrival, new.arrival]),
        np.concatenate([old.fate, new.fate]),
        join_fields([old.fields, new.fields], [len(old.points), len(new.points)]),
        new.frame_id,
        new.start_ns,
        new.end_ns,
        new.arrived,
        new.origin,
    )


def _origin(points: Array) -> Array | None:
    """The median, in whole kilometres, so that subtracting it is exact; zero near zero."""
    if not len(points):
        return None
    return np.floor(np.median(points, axis=0) / 1000.0 + 0.5) * 1000.0


def _fate(sweep: Sweep, arrived: int, budget: float) -> Array:
    """Who takes part; `budget` points at most, about, spread evenly by their serial number."""
    with np.errstate(invalid="ignore"):
        good = (np.abs(sweep.points) <= LARGEST).all(axis=1)
    fate = np.where(good, TAKES_PART, REJECTED).astype(np.int8)
    if len(fate) > budget:
        serial = np.arange(arrived, arrived + len(fate), dtype=np.uint64)
        share = (serial * WEYL) >> np.uint64(32)
        fate[good & (share >= np.uint64(budget / len(fate) * 2.0**32))] = THINNED
    return fate


def _budget(times: Array, window: Window | None, config: Config) -> float:
    """Points that max_points_per_second grants this update.

    It counts the time since the last one, but no gap: at most an update period or the sweep's own
    span, whichever is longer.
    """
    if config.max_points_per_second == 0 or not len(times):
        return np.inf
    span = float(times.max() - times.min()) / SECOND
    since = config.update_period
    if window is not None:
        since = max(0.0, float(times.max() - window.end_ns) / SECOND)
    return config.max_points_per_second * max(span, min(since, config.update_period))
