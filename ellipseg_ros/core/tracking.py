"""Persistent ids: segments inherit them from the previous update through shared points."""

from typing import NamedTuple

import numpy as np

from ellipseg_ros.core.contingency import Contingency, contingency, read_only
from ellipseg_ros.core.jit import kernel
from ellipseg_ros.records import Array, Ragged, State

LAST_ID = 2**32 - 1  # of uint32


class Tracks(NamedTuple):
    """Identity of s segments."""

    ids: Array  # (s,) uint32
    state: Array  # (s,) uint8, see State
    parents: Ragged  # (s,) rows of uint32, ascending: other old ids that gave points
    removed: Array  # (r,) uint32, ascending: ids of the previous update that ended


class Matching(NamedTuple):
    """Points that s new segments share with the old ones, and the best partner of each."""

    shared: Contingency  # points by new and old segment, without segments known to be the same
    best_old: Array  # (s,) int32: shares most points with it; ties: lower id; -1 for none
    best_new: Array  # (old,) int32: holds most of its points; ties: lower row; -1 for none


class Tracker:
    """Assigns persistent ids, from 1, none twice until all of uint32 are used up.

    It recognizes the segments of the previous update by their points.
    """

    def __init__(self) -> None:
        self._next = 1
        self._recycling = False  # whether ids are reused, all of uint32 having been given
        self._ended = np.zeros(0, np.uint32)  # ids ended by a reset, not yet in `removed`
        self._forget()

    def reset(self) -> None:
        """End all segments: the next update reports them as removed. Ids go on."""
        self._ended = np.concatenate([self._ended, self._ids])
        self._forget()

    def end(self) -> Array:
        """End all segments; returns their ids, (r,) uint32 ascending. Ids go on."""
        nothing = np.zeros(0, np.int64), np.zeros(0, np.int32), np.zeros((0, 1))
        return self.assign(*nothing).removed

    def _forget(self) -> None:
        self._arrival = np.zeros(0, np.int64)  # points of the previous update
        self._labels = np.zeros(0, np.int32)  # their rows in the next two
        self._ids = np.zeros(0, np.uint32)
        self._features = np.zeros((0, 1))

    def assign(
        self, arrival: Array, labels: Array, features: Array, same_as: Array | None = None
    ) -> Tracks:
        """Give every segment of an update its id.

        arrival (n,) int64, ascending: serial numbers of the points; labels (n,) int32: rows of
        features, negative for none; features (s, f): a segment is unchanged if they are bitwise
        equal, column 0 is its number of points; same_as (s,): the row of the previous segment
        with the same points where that is known, else -1; it saves time, and changes nothing.

        A segment inherits the id of the old segment with which it shares most points, if of all
        new segments it holds most of that one's remaining points. New ids ascend by row.
        """
        if same_as is None:
            same_as = np.full(len(features), -1, np.int32)
        matching = self._match(arrival, labels, features[:, 0], same_as)
        heirs = np.flatnonzero(matching.best_old >= 0)
        heirs = heirs[matching.best_new[matching.best_old[heirs]] == heirs]
        inherited = matching.best_old[heirs]

        ids = np.zeros(len(features), np.uint32)
        ids[heirs] = self._ids[inherited]
        fresh = np.flatnonzero(ids == 0)
        ids[fresh] = self._new_ids(len(fresh))

        whole = (same_as >= 0) | _undivided(matching.shared, features[:, 0])
        unchanged = whole[heirs] & (features[heirs] == self._features[inherited]).all(axis=1)
        state = np.full(len(features), State.NEW, np.uint8)
        state[heirs] = np.where(unchanged, State.UNCHANGED, State.UPDATED)
        removed = np.concatenate([self._ended, np.delete(self._ids, inherited)])
        tracks = Tracks(ids, state, self._parents(matching.shared, ids), np.sort(removed))

        self._arrival, self._labels, self._ids, self._features = arrival, labels, ids, features
        self._ended = np.zeros(0, np.uint32)
        return tracks

    def _match(self, arrival: Array, labels: Array, counts: Array, same_as: Array) -> Matching:
        shape = len(same_as), len(self._ids)
        previous = np.empty(len(labels), np.int32)
        now, before = (arrival, labels), (self._arrival, self._labels)
        arrays = (read_only(array) for array in (*now, *before, same_as))
        _previous_labels(*arrays, previous)
        shared = contingency(labels, previous, shape)
        best_old, best_new = (np.full(size, -1, np.int32) for size in shape)
        given = read_only(same_as), read_only(counts), read_only(self._ids)
        _best_partners(shared.starts, shared.columns, shared.counts, given, best_old, best_new)
        return Matching(shared, best_old, best_new)

    def _new_ids(self, count: int) -> Array:
        """(count,) uint32 ascending; when all are used up, from 1 on those that are free again."""
        if self._next + count > LAST_ID:
            self._next, self._recycling = 1, True
        if not self._recycling:
            ids = np.arange(self._next, self._next + count)
        else:
            taken = np.concatenate([self._ids, self._ended])
            ids = np.arange(self._next, self._next + count + len(taken))
            ids = ids[~np.isin(ids, taken)][:count]
        self._next = int(ids[-1]) + 1 if count else self._next
        return ids.astype(np.uint32)

    def _parents(self, shared: Contingency, ids: Array) -> Ragged:
        new, old_ids = shared.rows, self._ids[shared.columns]
        other = old_ids != ids[new]
        new, old_ids = new[other], old_ids[other]
        starts = np.append(0, np.cumsum(np.bincount(new, minlength=len(ids))))
        return Ragged(starts, old_ids[np.lexsort((old_ids, new))])


def _undivided(shared: Contingency, counts: Array) -> Array:
    """(s,) bool: segments all of whose points come from one old segment."""
    single = np.flatnonzero(np.diff(shared.starts) == 1)
    single = single[shared.counts[shared.starts[single]] == counts[single]]
    undivided = np.zeros(len(counts), bool)
    undivided[single] = True
    return undivided


@kernel
def _previous_labels(arrival, labels, old_arrival, old_labels, same_as, previous):
    """Write the old segment of every point, -1 for none, or if its segment is known to be old."""
    old = 0
    for i in range(len(labels)):
        previous[i] = -1
        if labels[i] < 0 or same_as[labels[i]] >= 0:
            continue
        while old < len(old_arrival) and old_arrival[old] < arrival[i]:
            old += 1
        if old < len(old_arrival) and old_arrival[old] == arrival[i]:
            previous[i] = old_labels[old]


@kernel
def _best_partners(starts, columns, counts, given, best_old, best_new):
    same_as, sizes, old_ids = given
    most = np.zeros(len(old_ids), np.int64)  # points in the best new segment of every old one
    for new in range(len(best_old)):
        best, shared = same_as[new], 0
        if best >= 0:
            best_new[best], most[best] = new, sizes[new]
        for entry in range(starts[new], starts[new + 1]):
            old, points = columns[entry], counts[entry]
            if points > shared or (points == shared and old_ids[old] < old_ids[best]):
                best, shared = old, points
            if points > most[old]:
                best_new[old], most[old] = new, points
        best_old[new] = best
