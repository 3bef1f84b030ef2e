"""Representatives: of the points in each small cell of surface, one stays in the window.

A dense lidar measures the same surface again and again. The first point in a cell becomes its
representative and never changes; later ones renew its life. The set depends on the stream of
points alone, not on how it is cut into sweeps.
"""

import math
from typing import NamedTuple

import numpy as np

from ellipseg_ros.core.jit import kernel
from ellipseg_ros.records import Array

REJECTED_POINT, LATE_POINT = -2, -1  # instead of the slot of a point
MAX_LEVEL = 3
MEAN_HITS = 16  # points after which the mean of a representative is frozen
MIN_SLOTS = 1024
# key: level and cell (x, y, z); sight_ns: greatest time of its points; hits: number of them;
# position: the founding point, m, local origin; total: sum of the first points relative to it;
# mean: of the first 1, 2, 4, 8 or 16 points, m, local origin.
SLOT = np.dtype(
    [
        ("key", "i8", (4,)),
        ("sight_ns", "i8"),
        ("serial", "i8"),
        ("hits", "i8"),
        ("position", "f8", (3,)),
        ("total", "f8", (3,)),
        ("mean", "f8", (3,)),
    ]
)


class Grid(NamedTuple):
    """Edge of the cells up to a range; it doubles with every doubling of the range."""

    resolution: float  # m
    range: float  # m


class Incoming(NamedTuple):
    """Points of a sweep, in the order of arrival; row i is point i."""

    points: Array  # (m, 3) float64, m, local origin
    times_ns: Array  # (m,) int64
    ranges: Array  # (m,) float64, m from the sensor; NaN: not known
    accepted: Array  # (m,) bool


class Representatives:
    """The cells that are occupied, with the representative of each.

    A representative is in one slot for life. Slots of dead ones are free after `compact`.
    """

    def __init__(self, grid: Grid) -> None:
        self._grid = grid
        self.slots = np.zeros(MIN_SLOTS, SLOT)
        self._table = np.full(4 * MIN_SLOTS, -1, np.int32)
        self._used = 0
        self.newest_ns: int | None = None  # greatest point time so far

    def assign(self, sweep: Incoming, duration_ns: int, serial: int) -> Array:
        """The slot of every point: (m,) int32, or REJECTED_POINT or LATE_POINT.

        serial: that of the first point. duration_ns: of the window; a representative that was not
        seen for so long is dead, and the next point in its cell founds another one.
        """
        self._reserve(len(sweep.points))
        slot_of = np.empty(len(sweep.points), np.int32)
        state = np.array([self._used, self.newest_ns or 0, self.newest_ns is not None], np.int64)
        _assign(sweep, self._grid, duration_ns, serial, self.slots, self._table, state, slot_of)
        self._used = int(state[0])
        self.newest_ns = int(state[1]) if state[2] else None
        return slot_of

    def evict(self, slots: Array, start_ns: int, limit: int) -> int:
        """End the representatives seen longest ago where more than `limit` are alive, 0: no limit.

        slots (n,) int32: of all, in the order of founding. Returns how many are ended.
        """
        sight_ns = self.slots["sight_ns"][slots]
        alive = np.flatnonzero(sight_ns > start_ns)
        surplus = len(alive) - limit
        if limit == 0 or surplus <= 0:
            return 0
        oldest = alive[np.argsort(sight_ns[alive], kind="stable")[:surplus]]
        self.slots["sight_ns"][slots[oldest]] = np.iinfo(np.int64).min
        return surplus

    def compact(self, alive: Array) -> Array | None:
        """Free the slots of dead representatives, if there are many; their new slots, else None.

        alive (n,) int32: slots that stay, in the order of founding; they become 0 to n - 1.
        """
        if self._used <= 2 * len(alive) + MIN_SLOTS:
            return None
        kept = self.slots[alive]
        self.slots = np.zeros(max(MIN_SLOTS, 2 * len(alive)), SLOT)
        self.slots[: len(kept)] = kept
        self._used = len(kept)
        self._rebuild()
        return np.arange(len(alive), dtype=np.int32)

    def _reserve(self, more: int) -> None:
        """Make room for so many new representatives."""
        needed = self._used + more
        if needed > len(self.slots):
            grown = np.zeros(2 * needed, SLOT)
            grown[: self._used] = self.slots[: self._used]
            self.slots = grown
        if 2 * needed > len(self._table):
            self._rebuild(more)

    def _rebuild(self, more: int = 0) -> None:
        size = 1 << (4 * max(MIN_SLOTS, self._used + more) - 1).bit_length()
        self._table = np.full(size, -1, np.int32)
        _insert(self.slots, self._used, self._table)


@kernel
def _hash(level, x, y, z, size):
    """Place of a cell in a table; size: a power of two. Teschner et al., VMV 2003, section 3.1."""
    value = (x * 73856093) ^ (y * 19349663) ^ (z * 83492791) ^ (level * 2654435)
    return (value ^ (value >> 15)) & (size - 1)


@kernel
def _find(slots, table, level, x, y, z):
    """Place in the table of a key, or of the free entry where it belongs."""
    place = _hash(level, x, y, z, len(table))
    while table[place] >= 0:
        key = slots[table[place]]["key"]
        if key[1] == x and key[2] == y and key[3] == z and key[0] == level:
            break
        place = (place + 1) % len(table)
    return place


@kernel
def _insert(slots, used, table):
    """Enter all slots; of two with the same key the later one, as the earlier is dead."""
    for slot in range(used):
        key = slots[slot]["key"]
        table[_find(slots, table, key[0], key[1], key[2], key[3])] = slot


@kernel
def _assign(sweep, grid, duration_ns, serial, slots, table, state, slot_of):
    used, newest = state[0], state[1]
    started = state[2] != 0
    for i in range(len(sweep.points)):
        if not sweep.accepted[i]:
            slot_of[i] = REJECTED_POINT
            continue
        time_ns = sweep.times_ns[i]
        if not started or time_ns > newest:
            newest, started = time_ns, True
        if time_ns <= newest - duration_ns:
            slot_of[i] = LATE_POINT
            continue
        point = sweep.points[i]
        level = level_of(sweep.ranges[i], grid.range)
        x, y, z = (
            np.int64(math.floor(point[0] / grid.resolution)) >> level,
            np.int64(math.floor(point[1] / grid.resolution)) >> level,
            np.int64(math.floor(point[2] / grid.resolution)) >> level,
        )
        place = _find(slots, table, level, x, y, z)
        slot = table[place]
        if slot < 0 or slots[slot]["sight_ns"] <= newest - duration_ns:
            slot = used
            used += 1
            table[place] = slot
            _found(slots[slot], (level, x, y, z), point, time_ns, serial + i)
        else:
            _renew(slots[slot], point, time_ns)
        slot_of[i] = slot
    state[0], state[1], state[2] = used, newest, started


@kernel
def level_of(distance, base):
    """0 up to the range `base`, 1 up to twice that, then 2, then 3; 0 where it is not known."""
    level = 0
    square, limit = distance * distance, base * base
    while level < MAX_LEVEL and square > limit:  # NaN is not
        level += 1
        limit *= 4.0
    return level


@kernel
def _found(slot, key, point, time_ns, serial):
    for axis in range(4):
        slot["key"][axis] = key[axis]
    for axis in range(3):
        slot["position"][axis] = point[axis]
        slot["mean"][axis] = point[axis]
        slot["total"][axis] = 0.0
    slot["sight_ns"] = time_ns
    slot["serial"] = serial
    slot["hits"] = 1


@kernel
def _renew(slot, point, time_ns):
    slot["sight_ns"] = max(slot["sight_ns"], time_ns)
    slot["hits"] += 1
    hits = slot["hits"]
    if hits > MEAN_HITS:
        return
    for axis in range(3):
        slot["total"][axis] += point[axis] - slot["position"][axis]
        if hits & (hits - 1) == 0:  # a power of two
            slot["mean"][axis] = slot["position"][axis] + slot["total"][axis] / hits
