"""Persistent ids of landmarks, and how stable they are from update to update."""

from typing import NamedTuple

import numpy as np

from ellipseg_ros.core.tracking import Tracker
from ellipseg_ros.landmarks.finder import Detections
from ellipseg_ros.landmarks.innovation import innovations, normalised_squares
from ellipseg_ros.records import Array, Kind

MEMORY = 5  # updates over which the innovation is averaged


class LandmarkTracks(NamedTuple):
    """Identity of l landmarks, in the order of the detections."""

    ids: Array  # (l,) uint32
    instability: Array  # (l,), see Landmarks
    first_seen_ns: Array  # (l,) int64
    removed: Array  # (r,) uint32, ascending: ids of the previous update that ended


class Previous(NamedTuple):
    """The landmarks of the previous update, ascending by id."""

    ids: Array
    position: Array
    axes: Array
    mean_square: Array  # (l,) mean of the normalised innovation squared
    age: Array  # (l,) int64, updates
    first_seen_ns: Array


NO_LANDMARKS = Previous(
    np.zeros(0, np.uint32),
    np.zeros((0, 3)),
    np.zeros((0, 3, 3)),
    np.zeros(0),
    np.zeros(0, np.int64),
    np.zeros(0, np.int64),
)


class LandmarkTracker:
    """Assigns ids by shared points, as for segments, to each kind separately.

    A landmark keeps its kind: a line that becomes a plane is a new landmark.
    """

    def __init__(self) -> None:
        self._trackers = {kind: Tracker() for kind in Kind}
        self._previous = NO_LANDMARKS

    def reset(self) -> None:
        """End all landmarks: the next update reports them as removed. Ids go on."""
        for tracker in self._trackers.values():
            tracker.reset()
        self._previous = NO_LANDMARKS

    def follow(self, arrival: Array, found: Detections, end_ns: int) -> LandmarkTracks:
        """Identify the landmarks of an update.

        arrival (n,) int64, ascending: serial numbers of the points; end_ns: end of the window.
        """
        ids, removed = self._assign(arrival, found)
        previous, fits = self._previous, found.fits
        place = np.searchsorted(previous.ids, ids)
        known = np.append(previous.ids, np.uint32(0))[place] == ids
        old, new = place[known], np.flatnonzero(known)
        before = previous.position[old], previous.axes[old]
        moved = innovations(found.kind[new], before, (fits.position[new], fits.axes[new]))
        squares = normalised_squares(found.kind[new], moved, fits.covariance[new])
        age, mean_square = np.zeros(len(ids), np.int64), np.zeros(len(ids))
        age[new] = previous.age[old] + 1
        mean = previous.mean_square[old]
        mean_square[new] = mean + (squares - mean) / np.minimum(age[new], MEMORY)
        first = np.full(len(ids), end_ns, np.int64)
        first[new] = previous.first_seen_ns[old]
        order = np.argsort(ids)
        columns = (ids, fits.position, fits.axes, mean_square, age, first)
        self._previous = Previous(*(column[order] for column in columns))
        return LandmarkTracks(ids, np.sqrt(mean_square), first, removed)

    def _assign(self, arrival: Array, found: Detections) -> tuple[Array, Array]:
        """Ids (l,) and those removed, from the numbers that the tracker of each kind assigns."""
        ids, removed = np.zeros(len(found.kind), np.uint32), []
        for kind, tracker in self._trackers.items():
            rows = np.flatnonzero(found.kind == kind)
            names = np.full(len(found.kind) + 1, -1, np.int32)
            names[rows] = np.arange(len(rows))
            features = np.column_stack([found.fits.count[rows], found.fits.position[rows]])
            tracks = tracker.assign(arrival, names[found.point_labels], features)
            ids[rows] = _interleave(tracks.ids, kind)
            removed.append(_interleave(tracks.removed, kind))
        return ids, np.sort(np.concatenate(removed))


def _interleave(numbers: Array, kind: Kind) -> Array:
    """Numbers 1, 2, ... of a kind as ids that no other kind has."""
    ids: Array = (numbers - 1) * np.uint32(len(Kind)) + np.uint32(kind + 1)
    return ids.astype(np.uint32)
