"""The points of the last seconds: arrivals, expiries, and which points are accepted."""

from typing import NamedTuple

import numpy as np

from ellipseg_ros.config import Config
from ellipseg_ros.core.column import Column
from ellipseg_ros.core.coordinates import ACCEPTED, check_points, origin_near
from ellipseg_ros.core.fields import Layout, join_fields, joined_layout, layout_of
from ellipseg_ros.core.representatives import (
    LATE_POINT,
    REJECTED_POINT,
    Grid,
    Incoming,
    Representatives,
)
from ellipseg_ros.records import LATE, SECOND, THINNED, Array, Sweep

MAX_WINDOW_BYTES = 2**30  # of the fields of a window: 2 million points of 512 bytes
# 2^64 / golden ratio: its multiples are spread evenly (Weyl sequence).
GOLDEN_RATIO_STEP = np.uint64(0x9E3779B97F4A7C15)


def max_window_points(max_points: int, layout: Layout) -> int:
    """`max_points`, or fewer where the fields of a point have many bytes; 0: no limit."""
    if max_points == 0 or layout is None:
        return max_points
    return min(max_points, MAX_WINDOW_BYTES // max(1, layout.itemsize))


class WindowPoints(NamedTuple):
    """The points with start_ns < t <= end_ns, in the order of arrival; row i is point i."""

    position: Array  # (n, 3) float64, m, world frame, as received
    times_ns: Array  # (n,) int64
    arrival: Array  # (n,) int64: serial number since the last reset
    fate: Array  # (n,) int8: ACCEPTED, REJECTED or THINNED


class Arrivals(NamedTuple):
    """What a sweep changed among the accepted points."""

    points: Array  # (m, 3) float64, m, local origin: the new ones
    serial: Array  # (m,) int64: their serial numbers
    expired: Array  # (e,) int64: serial numbers of accepted points that left, ascending
    late: int = 0  # new points, of any fate, that were older than the window already
    evicted: int = 0  # points, old or new, that `max_points` removed before their time
    filtered: int = 0  # as in Sweep
    unplaced: int = 0


class Selection(NamedTuple):
    """Which rows leave the window, and which points of a sweep enter it."""

    expires: Array  # (n,) bool
    stays: Array  # (m,) bool
    late: int
    evicted: int
    slot_of: Array | None = None  # (m,) int32, of Representatives; None: every point is kept


class Window:
    """A sliding window in sensor time, of all points or of representatives.

    Representatives expire when no point was seen in their cell for the duration of the window.
    """

    def __init__(self, origin: Array | None = None) -> None:
        self._columns = WindowPoints(
            Column(np.zeros((0, 3))),
            Column(np.zeros(0, np.int64)),
            Column(np.zeros(0, np.int64)),
            Column(np.zeros(0, np.int8)),
        )
        self._fields: Column | None = None
        self._cells: Representatives | None = None  # None: every point is kept
        self._slots = Column(np.zeros(0, np.int32))  # (n,) of the representatives
        self.sweep = Sweep(0, np.zeros((0, 3)))  # the last one
        self.sweep_rows = np.zeros(0, np.int64)
        self.frame_id = ""
        self.start_ns = 0
        self.end_ns = 0
        self.started = False
        self._origin = origin
        self._arrived = 0  # points since the reset
        self._finite = 0  # of them, points that were not rejected

    @property
    def points(self) -> WindowPoints:
        """The points in the window; read only."""
        return WindowPoints(*(column.values for column in self._columns))

    @property
    def accepted(self) -> Array:
        """(n,) bool: the points that are neither rejected nor thinned."""
        return np.asarray(self._columns.fate.values == ACCEPTED)

    @property
    def fields(self) -> Array | None:
        """(n,) structured: the fields of the input, where it has any."""
        return None if self._fields is None else self._fields.values

    @property
    def origin(self) -> Array:
        """(3,) m, subtracted from local coordinates; whole kilometres unless given."""
        return np.zeros(3) if self._origin is None else self._origin.copy()

    @property
    def hits(self) -> Array:
        """(n,) int64: points in the cell of every representative since it was founded."""
        if self._cells is None:
            return np.ones(len(self.points.arrival), np.int64)
        return np.asarray(self._cells.slots["hits"][self._slots.values])

    @property
    def means(self) -> Array:
        """(n, 3) float64, m, world frame: of the first points in the cell, at most 16."""
        if self._cells is None:
            return self.points.position
        return np.asarray(self._cells.slots["mean"][self._slots.values] + self.origin)

    @property
    def sight_ns(self) -> Array:
        """(n,) int64: time of the newest point in the cell of every representative."""
        if self._cells is None:
            return self.points.times_ns
        return np.asarray(self._cells.slots["sight_ns"][self._slots.values])

    def push(self, sweep: Sweep, config: Config) -> Arrivals:
        """Advance to the newest point of `sweep`; the end of the window never moves back.

        `sweep_rows` (m,) int64 then holds the row of every point of the sweep, or that of its
        representative; or else REJECTED or LATE.
        """
        self.sweep = sweep
        new = WindowPoints(
            sweep.points,
            sweep.times_ns,
            np.arange(self._arrived, self._arrived + len(sweep)),
            self._fates(sweep, self._budget(sweep.times_ns, config)),
        )
        old, accepted = self.points, new.fate == ACCEPTED
        select_rows = self._select_cells if config.resolution > 0.0 else self._select_points
        chosen = select_rows(new, sweep, config)
        arrivals = Arrivals(
            points=select(new.position, accepted & chosen.stays) - self.origin,
            serial=select(new.arrival, accepted & chosen.stays),
            expired=old.arrival[chosen.expires & (old.fate == ACCEPTED)],
            late=chosen.late,
            evicted=chosen.evicted,
            filtered=sweep.filtered,
            unplaced=sweep.unplaced,
        )
        self._arrived += len(sweep)
        self._replace_rows(chosen.expires, new, sweep.fields, chosen.stays)
        self.sweep_rows = self._rows_of(chosen, new.fate)
        if len(sweep) or not self.started:
            self.frame_id = sweep.frame_id
        self.started = True
        return arrivals

    def _select_points(self, new: WindowPoints, sweep: Sweep, config: Config) -> Selection:
        """Every point stays until its own time has passed."""
        times = new.times_ns
        if self._origin is None:
            self._origin = origin_near(new.position[new.fate == ACCEPTED])
        ends = [int(times.max())] if len(times) else []
        self.end_ns = max([*ends, self.end_ns] if self.started else ends, default=sweep.stamp_ns)
        self.start_ns = self.end_ns - round(config.window_duration * SECOND)
        expires = self.points.times_ns <= self.start_ns
        late = times <= self.start_ns  # possible, within max_lateness of a short window
        late_count = int(late.sum())
        evicted = self._evict(expires, times, late, self._limit(sweep.fields, config))
        return Selection(expires, ~late, late_count, evicted)

    def _select_cells(self, new: WindowPoints, sweep: Sweep, config: Config) -> Selection:
        """The first point of each cell stays until none has been seen there for the duration."""
        accepted = new.fate == ACCEPTED
        if self._origin is None:  # that of the first point: it must not depend on the others
            self._origin = origin_near(new.position[accepted][:1])
        if self._cells is None:
            self._cells = Representatives(Grid(config.resolution, config.resolution_range))
        cells, duration_ns = self._cells, round(config.window_duration * SECOND)
        ranges = np.full(len(sweep), np.nan) if sweep.ranges is None else sweep.ranges
        incoming = Incoming(new.position - self.origin, new.times_ns, ranges, accepted)
        slot_of = cells.assign(incoming, duration_ns, self._arrived)
        self.end_ns = sweep.stamp_ns if cells.newest_ns is None else cells.newest_ns
        self.start_ns = self.end_ns - duration_ns
        founded = (slot_of >= 0) & (cells.slots["serial"][slot_of] == new.arrival)
        candidates = np.concatenate([self._slots.values, slot_of[founded]])
        evicted = cells.evict(candidates, self.start_ns, self._limit(sweep.fields, config))
        alive = cells.slots["sight_ns"] > self.start_ns
        late = int(np.count_nonzero(slot_of == LATE_POINT))
        expires, stays = ~alive[self._slots.values], founded & alive[slot_of]
        return Selection(expires, stays, late, evicted, slot_of)

    def _rows_of(self, chosen: Selection, fate: Array) -> Array:
        """(m,) rows in the window of the points of a sweep with these fates, or REJECTED, LATE."""
        cells, slot_of = self._cells, chosen.slot_of
        if cells is None or slot_of is None:
            first = len(self.points.arrival) - int(chosen.stays.sum())
            return np.where(chosen.stays, first + np.cumsum(chosen.stays) - 1, LATE)
        self._slots.drop(chosen.expires)
        self._slots.append(slot_of[chosen.stays])
        row_of = np.full(len(cells.slots) + 1, LATE, np.int64)
        row_of[self._slots.values] = np.arange(len(self._slots.values))
        rows = np.where(slot_of == REJECTED_POINT, fate, row_of[np.maximum(slot_of, -1)])
        compacted = cells.compact(self._slots.values)
        if compacted is not None:
            self._slots = Column(compacted)
        return rows

    def as_arrivals(self, last: Arrivals) -> Arrivals:
        """All accepted points as new ones, for a new graph; the counts are those of `last`."""
        local = self.points.position[self.accepted] - self.origin
        serial = self.points.arrival[self.accepted]
        return last._replace(points=local, serial=serial, expired=np.zeros(0, np.int64))

    def _limit(self, fields: Array | None, config: Config) -> int:
        """Points that may stay; 0: no limit."""
        if fields is None:
            return config.max_points
        layout = joined_layout(layout_of(self.fields), fields.dtype)
        return max_window_points(config.max_points, layout)

    def _evict(self, expires: Array, times: Array, late: Array, limit: int) -> int:
        """Evict the oldest points where more than `limit` would stay; returns how many.

        Points of one time go together, unless that would be all. Marks them in `expires` (old
        points) and `late` (new ones).
        """
        old, new = np.flatnonzero(~expires), np.flatnonzero(~late)
        surplus = len(old) + len(new) - limit
        if limit == 0 or surplus <= 0:
            return 0
        age = np.concatenate([self.points.times_ns[old], times[new]])
        self.start_ns = int(np.partition(age, surplus - 1)[surplus - 1])
        evicted = age <= self.start_ns
        if evicted.all():
            self.start_ns -= 1
            evicted[np.flatnonzero(age > self.start_ns)[surplus - len(evicted) :]] = False
        expires[old[evicted[: len(old)]]] = True
        late[new[evicted[len(old) :]]] = True
        return int(evicted.sum())

    def _replace_rows(
        self, expires: Array, new: WindowPoints, fields: Array | None, stays: Array
    ) -> None:
        """Drop the old rows that expire, append the new ones that stay."""
        old_fields = self.fields
        for column, rows in zip(self._columns, new, strict=True):
            column.drop(expires)
            column.append(select(rows, stays))
        added = None if fields is None else select(fields, stays)
        if self._fields is not None and added is not None and added.dtype == self._fields.dtype:
            self._fields.drop(expires)
            self._fields.append(added)
            return
        kept = None if old_fields is None else old_fields[~expires]
        joined = join_fields([kept, added], [int((~expires).sum()), int(stays.sum())])
        self._fields = None if joined is None else Column(joined)

    def _fates(self, sweep: Sweep, budget: float) -> Array:
        """(n,) int8: REJECTED where not finite; about `budget` others, evenly spread, ACCEPTED."""
        fates = np.empty(len(sweep), np.int8)
        count = check_points(sweep.points, fates)
        if count > budget:
            serial = np.arange(self._finite, self._finite + count, dtype=np.uint64)
            share = (serial * GOLDEN_RATIO_STEP) >> np.uint64(32)
            finite = np.flatnonzero(fates == ACCEPTED)
            fates[finite[share >= np.uint64(budget / count * 2.0**32)]] = THINNED
        self._finite += count
        return fates

    def _budget(self, times: Array, config: Config) -> float:
        """Points that max_points_per_second grants this update.

        It counts the time since the last one, but no gap: at most an update period or the sweep's
        own span, whichever is longer. A sweep without newer times counts with its own span.
        """
        if config.max_points_per_second == 0 or not len(times):
            return np.inf
        span = float(times.max() - times.min()) / SECOND
        since = config.update_period
        if self.started and times.max() > self.end_ns:
            since = min(since, float(times.max() - self.end_ns) / SECOND)
        return config.max_points_per_second * max(span, since)


def select(rows: Array, mask: Array) -> Array:
    """The rows where `mask` (n,) bool; without a copy where that is all of them."""
    return rows if mask.all() else rows[mask]
