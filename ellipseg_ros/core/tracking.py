"""Persistent ids: which segment of before is which segment of now."""

from typing import NamedTuple

import numpy as np

from ellipseg_ros.core.jit import kernel
from ellipseg_ros.records import Array, Ragged, State

LAST_ID = 2**32 - 1  # of uint32


class Tracks(NamedTuple):
    """What became of the segments; s segments of now."""

    ids: Array  # (s,) uint32
    state: Array  # (s,) uint8, see State
    parents: Ragged  # (s,) rows of uint32, ascending: old ids that gave points, but the own one
    removed: Array  # (r,) uint32, ascending


class Labelled(NamedTuple):
    """Points and their segments."""

    arrival: Array  # (n,) int64 ascending
    labels: Array  # (n,) int32, negative for none


class Shares(NamedTuple):
    """How many surviving points the old segments gave the new ones; pairs by new, then old row."""

    starts: Array  # (s + 1,) int64: pairs of new segment k are starts[k] to starts[k + 1]
    old: Array  # (p,) int32
    points: Array  # (p,) int64
    best_old: Array  # (s,) int32: shares most points with it; ties: lower id; -1 for none
    best_new: Array  # (old,) int32: holds most of its points; ties: lower row


class Tracker:
    """Gives ids, from 1, and none twice until all of uint32 are used up.

    It knows the segments of the last update by their points.
    """

    def __init__(self) -> None:
        self._next = 1
        self._again = False  # whether ids are given that were given before
        self._gone = np.zeros(0, np.uint32)  # ids that a reset has ended, not yet told
        self._forget()

    def reset(self) -> None:
        """End all segments: the next update names them removed. Ids go on."""
        self._gone = np.concatenate([self._gone, self._ids])
        self._forget()

    def end(self) -> Array:
        """End all segments; returns their ids, (r,) uint32 ascending. New ids go on."""
        nothing = np.zeros(0, np.int64), np.zeros(0, np.int32), np.zeros((0, 1))
        return self.assign(*nothing).removed

    def _forget(self) -> None:
        self._arrival = np.zeros(0, np.int64)  # points of the last window
        self._labels = np.zeros(0, np.int32)  # their rows in the next two
        self._ids = np.zeros(0, np.uint32)
        self._facts = np.zeros((0, 0))

    def assign(
        self, arrival: Array, labels: Array, facts: Array, before: Array | None = None
    ) -> Tracks:
        """Name the segments of now.

        arrival (n,) int64 ascending; labels (n,) int32, rows of facts, negative for none;
        facts (s, f): what makes a segment the same if it is bitwise equal, the count in column 0;
        before (s,): rows of the last segments with the same points, where that is known, else -1:
        it saves time, and changes nothing.

        A segment inherits the id of the old segment with which it shares most points, if of all
        new segments it holds most of that one's surviving points. New ids ascend by row.
        """
        if before is None:
            before = np.full(len(facts), -1, np.int32)
        now, last = Labelled(arrival, labels), Labelled(self._arrival, self._labels)
        shares = _share(now, last, before, facts[:, 0], self._ids)
        heirs = np.flatnonzero(shares.best_old >= 0)
        heirs = heirs[shares.best_new[shares.best_old[heirs]] == heirs]
        inherited = shares.best_old[heirs]

        ids = np.zeros(len(facts), np.uint32)
        ids[heirs] = self._ids[inherited]
        fresh = np.flatnonzero(ids == 0)
        ids[fresh] = self._new_ids(len(fresh))

        state = np.full(len(facts), State.NEW, np.uint8)
        state[heirs] = State.UPDATED
        state[heirs[self._same(heirs, inherited, shares, facts)]] = State.UNCHANGED
        ended = np.ones(len(self._ids), bool)
        ended[inherited] = False
        removed = np.sort(np.concatenate([self._gone, self._ids[ended]]))
        parents = self._parents(shares, ids)

        self._arrival, self._labels, self._ids, self._facts = arrival, labels, ids, facts
        self._gone = np.zeros(0, np.uint32)
        return Tracks(ids, state, parents, removed)

    def _new_ids(self, count: int) -> Array:
        """(count,) uint32 ascending; when all are used up, from 1 on those that are free again."""
        if self._next + count > LAST_ID:
            self._next, self._again = 1, True
        if not self._again:
            ids = np.arange(self._next, self._next + count)
        else:
            taken = np.concatenate([self._ids, self._gone])
            ids = np.arange(self._next, self._next + count + len(taken))
            ids = ids[~np.isin(ids, taken)][:count]
        self._next = int(ids[-1]) + 1 if count else self._next
        return ids.astype(np.uint32)

    def _same(self, heirs: Array, inherited: Array, shares: Shares, facts: Array) -> Array:
        """(heirs,) bool: the same points and the same facts as before."""
        if not len(heirs):
            return np.zeros(0, bool)
        one = shares.starts[heirs + 1] - shares.starts[heirs] == 1
        whole = shares.points[shares.starts[heirs]] == facts[heirs, 0]
        equal: Array = (facts[heirs] == self._facts[inherited]).all(axis=1)
        same: Array = one & whole & equal
        return same

    def _parents(self, shares: Shares, ids: Array) -> Ragged:
        new = np.repeat(np.arange(len(ids)), np.diff(shares.starts))
        old_ids = self._ids[shares.old]
        other = old_ids != ids[new]
        new, old_ids = new[other], old_ids[other]
        starts = np.zeros(len(ids) + 1, np.int64)
        np.cumsum(np.bincount(new, minlength=len(ids)), out=starts[1:])
        return Ragged(starts, old_ids[np.lexsort((old_ids, new))])


def _share(now: Labelled, last: Labelled, before: Array, counts: Array, old_ids: Array) -> Shares:
    segments, size = len(before), len(now.labels)
    starts = np.zeros(segments + 1, np.int64)
    pairs, points = np.empty(size, np.int32), np.empty(size, np.int64)
    best_old = np.full(segments, -1, np.int32)
    best_new = np.full(len(old_ids), -1, np.int32)
    found = Shares(starts, pairs, points, best_old, best_new)
    now, last = Labelled(*map(_to_read, now)), Labelled(*map(_to_read, last))
    _fill(now, last, _to_read(before), _to_read(counts), _to_read(old_ids), found)
    return found._replace(old=pairs[: starts[-1]], points=points[: starts[-1]])


def _to_read(array: Array) -> Array:
    """A view that cannot be written: of one type, so that the kernel is compiled once."""
    view = np.ascontiguousarray(array).view()
    view.flags.writeable = False
    return view


@kernel
def _fill(now, last, before, counts, old_ids, shares):
    starts, pairs, points, best_old, best_new = shares
    segments = len(starts) - 1
    # The points of changed segments, by segment, in order: from which old one they come.
    ends = np.zeros(segments + 1, np.int64)
    for label in now.labels:
        if label >= 0 and before[label] < 0:
            ends[label + 1] += 1
    for s in range(segments):
        ends[s + 1] += ends[s]
    place = ends.copy()
    by_segment = np.empty(ends[segments], np.int32)
    _old_rows(now, last, before, place, by_segment)
    # What each old segment gave.
    given = np.zeros(len(old_ids), np.int64)
    most = np.zeros(len(old_ids), np.int64)
    count = 0
    for s in range(segments):
        starts[s] = count
        if before[s] >= 0:
            given[before[s]] = counts[s]
            pairs[count] = before[s]
            count += 1
        for k in range(ends[s], ends[s + 1]):
            row = by_segment[k]
            if row >= 0:
                if given[row] == 0:
                    pairs[count] = row
                    count += 1
                given[row] += 1
        best = -1
        for pair in range(starts[s], count):
            row = pairs[pair]
            points[pair] = given[row]
            if (
                best < 0
                or given[row] > given[best]
                or (given[row] == given[best] and old_ids[row] < old_ids[best])
            ):
                best = row
            if given[row] > most[row]:
                most[row] = given[row]
                best_new[row] = s
        best_old[s] = best
        for pair in range(starts[s], count):
            given[pairs[pair]] = 0
    starts[segments] = count


@kernel
def _old_rows(now, last, before, place, by_segment):
    """Write the old segments of the points of changed segments, -1 for none, each to its place."""
    old = 0
    for i in range(len(now.labels)):
        label = now.labels[i]
        if label < 0 or before[label] >= 0:
            continue
        while old < len(last.arrival) and last.arrival[old] < now.arrival[i]:
            old += 1
        known = old < len(last.arrival) and last.arrival[old] == now.arrival[i]
        by_segment[place[label]] = last.labels[old] if known else -1
        place[label] += 1
