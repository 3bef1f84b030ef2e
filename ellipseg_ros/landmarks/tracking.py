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


TRACKED = np.dtype(  # a landmark as the next update needs it
    [
        ("ids", np.uint32),
        ("position", np.float64, 3),
        ("axes", np.float64, (3, 3)),
        ("mean_square", np.float64),  # mean of the normalised innovation squared
        ("age", np.int64),  # updates
        ("first_seen_ns", np.int64),
    ]
)


class LandmarkTracker:
    """Assigns ids by shared points, as for segments, to each kind separately.

    A landmark keeps its kind: a line that becomes a plane is a new landmark.
    """

    def __init__(self) -> None:
        self._trackers = {kind: Tracker() for kind in Kind}
        self._previous = np.zeros(0, TRACKED)  # ascending by id

    def reset(self) -> None:
        """End all landmarks: the next update reports them as removed. Ids go on."""
        for tracker in self._trackers.values():
            tracker.reset()
        self._previous = np.zeros(0, TRACKED)

    def follow(self, arrival: Array, found: Detections, end_ns: int) -> LandmarkTracks:
        """Identify the landmarks of an update.

        arrival (n,) int64, ascending: serial numbers of the points; end_ns: end of the window.
        """
        ids, removed = self._assign(arrival, found)
        previous, fits = self._previous, found.fits
        tracked = np.zeros(len(ids), TRACKED)
        tracked["ids"], tracked["first_seen_ns"] = ids, end_ns
        tracked["position"], tracked["axes"] = fits.position, fits.axes
        place = np.searchsorted(previous["ids"], ids)
        known = np.append(previous["ids"], np.uint32(0))[place] == ids
        old, new = previous[place[known]], np.flatnonzero(known)
        kind, before = found.kind[new], (old["position"], old["axes"])
        moved = innovations(kind, before, (fits.position[new], fits.axes[new]))
        squares = normalised_squares(kind, moved, fits.covariance[new])
        age, mean = old["age"] + 1, old["mean_square"]
        tracked["age"][new] = age
        tracked["mean_square"][new] = mean + (squares - mean) / np.minimum(age, MEMORY)
        tracked["first_seen_ns"][new] = old["first_seen_ns"]
        self._previous = tracked[np.argsort(ids)]
        instability = np.sqrt(tracked["mean_square"])
        return LandmarkTracks(ids, instability, tracked["first_seen_ns"], removed)

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
