"""The points of the last seconds: arrivals, expiries, and who takes part."""

from typing import NamedTuple

import numpy as np

from ellipseg_ros.config import Config
from ellipseg_ros.core.column import Column
from ellipseg_ros.core.jit import kernel
from ellipseg_ros.records import (
    REJECTED,
    SECOND,
    THINNED,
    Array,
    Sweep,
    join_fields,
    joined_layout,
)

LARGEST = 1e8  # m: a coordinate beyond is no measurement (the Earth's radius is 6.4e6 m)
MOST_BYTES = 2**30  # of the fields of a window: 2 million points of 512 bytes
TAKES_PART = 0  # fate of a point that has not been rejected or thinned
WEYL = np.uint64(0x9E3779B97F4A7C15)  # 2^64 / golden ratio: multiples are spread evenly


class Points(NamedTuple):
    """The points with start_ns < t <= end_ns, in the order of arrival; row i is point i."""

    position: Array  # (n, 3) float64, m, world frame, as they came
    times_ns: Array  # (n,) int64
    arrival: Array  # (n,) int64: serial number since the last reset
    fate: Array  # (n,) int8: TAKES_PART, REJECTED or THINNED


class Push(NamedTuple):
    """What a sweep changed among the points that take part."""

    arrived: Array  # (m, 3) float64, m, local origin
    serial: Array  # (m,) int64: their serial numbers
    expired: Array  # (e,) int64: serial numbers, among those that took part; ascending
    late: int = 0  # new points, of any fate, that were older than the window already
    evicted: int = 0  # points, old or new, that expired early for `max_points`


class Window:
    """A sliding window in sensor time."""

    def __init__(self, origin: Array | None = None) -> None:
        self._columns = Points(
            Column(np.zeros((0, 3))),
            Column(np.zeros(0, np.int64)),
            Column(np.zeros(0, np.int64)),
            Column(np.zeros(0, np.int8)),
        )
        self._fields: Column | None = None
        self.frame_id = ""
        self.start_ns = 0
        self.end_ns = 0
        self.started = False
        self._origin = origin
        self._arrived = 0  # points so far
        self._counted = 0  # of them, those that were not rejected

    @property
    def points(self) -> Points:
        """The points of now; read only."""
        return Points(*(column.values for column in self._columns))

    @property
    def fields(self) -> Array | None:
        """(n,) structured: the fields of the input, where it has any."""
        return None if self._fields is None else self._fields.values

    @property
    def origin(self) -> Array:
        """(3,) m: what local coordinates count from; whole kilometres unless given."""
        return np.zeros(3) if self._origin is None else self._origin.copy()

    def push(self, sweep: Sweep, config: Config) -> Push:
        """Move on to the newest point of `sweep`, but never back."""
        times = sweep.times_ns
        new = Points(
            sweep.points,
            times,
            np.arange(self._arrived, self._arrived + len(times)),
            self._fate(sweep, self._budget(times, config)),
        )
        takes_part = new.fate == TAKES_PART
        if self._origin is None:
            self._origin = _origin(sweep.points[takes_part])
        ends = [int(times.max())] if len(times) else []
        self.end_ns = max([*ends, self.end_ns] if self.started else ends, default=sweep.stamp_ns)
        self.start_ns = self.end_ns - round(config.window_duration * SECOND)

        old = self.points
        gone = old.times_ns <= self.start_ns
        late = times <= self.start_ns  # possible, within max_lateness of a short window
        too_late = int(late.sum())
        evicted = self._make_room(gone, times, late, self._limit(sweep.fields, config))
        expired = old.arrival[gone & (old.fate == TAKES_PART)]
        comes = takes_part & ~late
        arrived = chosen(new.position, comes) - self.origin
        serial = chosen(new.arrival, comes)
        self._arrived += len(times)
        self._move(gone, new, sweep.fields, ~late)
        if len(sweep) or not self.started:
            self.frame_id = sweep.frame_id
        self.started = True
        return Push(arrived, serial, expired, too_late, evicted)

    def everything(self) -> Push:
        """All points that take part, as if they had just arrived."""
        comes = self.points.fate == TAKES_PART
        local = self.points.position[comes] - self.origin
        return Push(local, self.points.arrival[comes], np.zeros(0, np.int64))

    def _limit(self, come: Array | None, config: Config) -> int:
        """Points that may stay: max_points, but less where each of them has many bytes."""
        if config.max_points == 0 or come is None:
            return config.max_points
        here = None if self.fields is None else self.fields.dtype
        layout = joined_layout(here, come.dtype) or come.dtype
        return min(config.max_points, MOST_BYTES // max(1, layout.itemsize))

    def _make_room(self, gone: Array, times: Array, late: Array, limit: int) -> int:
        """Let the oldest points expire early, where more than `limit` would stay; how many.

        Points of one time go together, unless that would be all. Marks them in `gone` and `late`.
        """
        stay, come = np.flatnonzero(~gone), np.flatnonzero(~late)
        surplus = len(stay) + len(come) - limit
        if limit == 0 or surplus <= 0:
            return 0
        age = np.concatenate([self.points.times_ns[stay], times[come]])
        self.start_ns = int(np.partition(age, surplus - 1)[surplus - 1])
        early = age <= self.start_ns
        if early.all():
            self.start_ns -= 1
            early[np.flatnonzero(age > self.start_ns)[surplus - len(early) :]] = False
        gone[stay[early[: len(stay)]]] = True
        late[come[early[len(stay) :]]] = True
        return int(early.sum())

    def _move(self, gone: Array, new: Points, fields: Array | None, stays: Array) -> None:
        """Drop the old rows that are `gone`, add the new ones that stay."""
        old_fields = self.fields
        for column, rows in zip(self._columns, new, strict=True):
            column.drop(gone)
            column.append(chosen(rows, stays))
        come = None if fields is None else chosen(fields, stays)
        if self._fields is not None and come is not None and come.dtype == self._fields.dtype:
            self._fields.drop(gone)
            self._fields.append(come)
            return
        kept = None if old_fields is None else old_fields[~gone]
        joined = join_fields([kept, come], [int((~gone).sum()), int(stays.sum())])
        self._fields = None if joined is None else Column(joined)

    def _fate(self, sweep: Sweep, budget: float) -> Array:
        """Who takes part; about `budget` points at most, spread evenly among the good ones."""
        fate = np.empty(len(sweep), np.int8)
        count = _check(sweep.points, fate)
        if count > budget:
            serial = np.arange(self._counted, self._counted + count, dtype=np.uint64)
            share = (serial * WEYL) >> np.uint64(32)
            good = np.flatnonzero(fate == TAKES_PART)
            fate[good[share >= np.uint64(budget / count * 2.0**32)]] = THINNED
        self._counted += count
        return fate

    def _budget(self, times: Array, config: Config) -> float:
        """Points that max_points_per_second grants this update.

        It counts the time since the last one, but no gap: at most an update period or the sweep's
        own span, whichever is longer. A sweep that brings no newer time has its own period.
        """
        if config.max_points_per_second == 0 or not len(times):
            return np.inf
        span = float(times.max() - times.min()) / SECOND
        since = config.update_period
        if self.started and times.max() > self.end_ns:
            since = min(since, float(times.max() - self.end_ns) / SECOND)
        return config.max_points_per_second * max(span, since)


@kernel
def _check(points, fate):
    """Reject points that are not finite, or too far to be real; returns how many are left."""
    count = 0
    for i in range(len(points)):
        good = True
        for axis in range(3):
            good = good and abs(points[i, axis]) <= LARGEST  # NaN is not
        fate[i] = TAKES_PART if good else REJECTED
        count += good
    return count


def chosen(rows: Array, mask: Array) -> Array:
    """The rows where `mask` (n,) bool; as they are where that is all, which is the rule."""
    return rows if mask.all() else rows[mask]


def _origin(points: Array) -> Array | None:
    """The median of some, in whole kilometres: subtracting it is exact; zero near zero."""
    if not len(points):
        return None
    some = points[:: len(points) // 1000 + 1]
    kilometres: Array = np.floor(np.median(some, axis=0) / 1000.0 + 0.5)
    return kilometres * 1000.0
