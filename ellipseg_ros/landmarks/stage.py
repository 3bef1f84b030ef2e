"""The landmarks of a window, with persistent ids."""

import numpy as np

from ellipseg_ros.config import LandmarksConfig
from ellipseg_ros.core.contingency import contingency
from ellipseg_ros.core.segments import Segments
from ellipseg_ros.core.window import Window
from ellipseg_ros.landmarks.finder import Detections, find_landmarks
from ellipseg_ros.landmarks.tracking import LandmarkTracker, LandmarkTracks
from ellipseg_ros.records import Array, Landmarks, Ragged, SegmentAdjacency


class LandmarkStage:
    """Chooses landmarks; keeps their ids and instability from update to update."""

    def __init__(self) -> None:
        self._tracker = LandmarkTracker()

    def reset(self) -> None:
        """End all landmarks: the next update lists them as removed. Ids go on."""
        self._tracker.reset()

    def update(
        self,
        window: Window,
        segments: Segments,
        adjacency: SegmentAdjacency | None,
        config: LandmarksConfig,
    ) -> Landmarks | None:
        """The landmarks of the window; None without adjacency, or where they are not enabled."""
        if adjacency is None or not config.enabled:
            return None
        points, origin = window.points, window.origin
        local = points.position - origin
        found = find_landmarks(local, segments.labels, segments.moments, adjacency, config)
        tracks = self._tracker.follow(points.arrival, found, window.end_ns)
        return landmark_records(found, tracks, segments.labels, origin)


def landmark_records(
    found: Detections, tracks: LandmarkTracks, labels: Array, origin: Array
) -> Landmarks:
    """What was found of landmarks as a record in the world frame, ascending by id.

    labels (n,) int32: the segment of every point; origin (3,) m.
    """
    order = np.argsort(tracks.ids)
    rank = np.full(len(order) + 1, -1, np.int32)
    rank[order] = np.arange(len(order))
    fits, point_labels = found.fits.select(order), rank[found.point_labels]
    return Landmarks(
        ids=tracks.ids[order],
        kind=found.kind[order],
        count=fits.count,
        position=fits.position + origin,
        axes=fits.axes,
        sigma=fits.sigma,
        box_min=fits.box_min,
        box_max=fits.box_max,
        covariance=fits.covariance,
        instability=tracks.instability[order],
        first_seen_ns=tracks.first_seen_ns[order],
        segments=_segments_of(point_labels, labels, len(order)),
        point_labels=point_labels,
        removed=tracks.removed,
    )


def _segments_of(point_labels: Array, labels: Array, landmarks: int) -> Ragged:
    """The segments that the points of every landmark are in."""
    shared = contingency(point_labels, labels, (landmarks, int(labels.max(initial=-1)) + 1))
    return Ragged(shared.starts, shared.columns.astype(np.int64))
