"""Which landmark of before is which of now, and how much it has moved."""

from typing import NamedTuple

import numpy as np

from ellipseg_ros.core.tracking import Tracker
from ellipseg_ros.landmarks.finder import Found
from ellipseg_ros.landmarks.motions import motions, normalised
from ellipseg_ros.records import Array, Kind

MEMORY = 5  # updates that the stability looks back


class Followed(NamedTuple):
    """What became of the landmarks; l of them, in the order found."""

    ids: Array  # (l,) uint32
    stability: Array  # (l,)
    first_seen_ns: Array  # (l,) int64
    removed: Array  # (r,) uint32, ascending


class Past(NamedTuple):
    """The landmarks of the last update, ascending by id."""

    ids: Array
    position: Array
    axes: Array
    unrest: Array  # (l,) mean normalised squared motion
    age: Array  # (l,) int64, updates
    first_seen_ns: Array


class LandmarkTracker:
    """Gives ids, by shared points as segments get them, to each kind by itself.

    A landmark keeps its kind: what was a line and is a plane is another one.
    """

    def __init__(self) -> None:
        self._trackers = {kind: Tracker() for kind in Kind}
        self._forget()

    def reset(self) -> None:
        """End all landmarks: the next update names them removed. Ids go on."""
        for tracker in self._trackers.values():
            tracker.reset()
        self._forget()

    def _forget(self) -> None:
        nobody = np.zeros(0)
        self._past = Past(
            np.zeros(0, np.uint32),
            np.zeros((0, 3)),
            np.zeros((0, 3, 3)),
            nobody,
            np.zeros(0, np.int64),
            np.zeros(0, np.int64),
        )

    def follow(self, arrival: Array, found: Found, end_ns: int) -> Followed:
        """Name the landmarks of now; arrival (n,) int64, of the points, ascending."""
        ids, removed = self._name(arrival, found)
        past, fits = self._past, found.fits
        place = np.searchsorted(past.ids, ids)
        known = np.append(past.ids, np.uint32(0))[place] == ids
        old, new = place[known], np.flatnonzero(known)
        moved = motions(
            found.kind[new],
            (past.position[old], past.axes[old]),
            (fits.position[new], fits.axes[new]),
        )
        age = np.zeros(len(ids), np.int64)
        age[new] = past.age[old] + 1
        unrest = np.zeros(len(ids))
        squared = normalised(found.kind[new], moved, fits.covariance[new])
        unrest[new] = past.unrest[old] + (squared - past.unrest[old]) / np.minimum(
            age[new], MEMORY
        )
        first = np.full(len(ids), end_ns, np.int64)
        first[new] = past.first_seen_ns[old]
        order = np.argsort(ids)
        columns = (ids, fits.position, fits.axes, unrest, age, first)
        self._past = Past(*(column[order] for column in columns))
        return Followed(ids, np.sqrt(unrest), first, removed)

    def _name(self, arrival: Array, found: Found) -> tuple[Array, Array]:
        """Ids of now, and those removed, from the numbers that the tracker of each kind gives."""
        ids, removed = np.zeros(len(found.kind), np.uint32), []
        for kind, tracker in self._trackers.items():
            rows = np.flatnonzero(found.kind == kind)
            names = np.full(len(found.kind) + 1, -1, np.int32)
            names[rows] = np.arange(len(rows))
            labels = names[found.of_point]
            labels.flags.writeable = False
            facts = np.column_stack([found.fits.count[rows], found.fits.position[rows]])
            tracks = tracker.assign(arrival, labels, facts)
            ids[rows], gone = _spread(tracks.ids, kind), _spread(tracks.removed, kind)
            removed.append(gone)
        return ids, np.sort(np.concatenate(removed))


def _spread(numbers: Array, kind: Kind) -> Array:
    """1, 2, ... of a kind as ids that no other kind has."""
    ids: Array = (numbers - 1) * np.uint32(len(Kind)) + np.uint32(kind + 1)
    return ids.astype(np.uint32)
