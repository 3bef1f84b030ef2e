"""The segments of a window: moments, times and persistent ids."""

from typing import NamedTuple

import numpy as np

from ellipseg_ros.core.ellipsoids import segment_moments, segment_times
from ellipseg_ros.core.graph import Graph
from ellipseg_ros.core.merge import Merged
from ellipseg_ros.core.moments import no_moments
from ellipseg_ros.core.tracking import Tracker, Tracks
from ellipseg_ros.core.window import Window
from ellipseg_ros.records import Array, Ellipsoids


class Segments(NamedTuple):
    """The segments after an update; n points in the window, s segments."""

    labels: Array  # (n,) int32: segment of every point, or its fate
    vertex_labels: Array  # (rows,) int32: segment of every vertex of the graph, -1 for none
    moments: Array  # (s,) MOMENTS of the points
    model: Array  # (s,) MOMENTS of the unions of initial ellipsoids
    aicc: Array  # (s,) float64
    times_ns: Array  # (s, 2) int64: of the oldest and of the newest point
    tracks: Tracks


class SegmentStage:
    """Turns merged vertices into segments; keeps their moments and ids from update to update."""

    def __init__(self) -> None:
        self._tracker = Tracker()
        self.clear_cache()

    def reset(self) -> None:
        """End all segments: the next update lists them as removed. Ids go on."""
        self._tracker.reset()
        self.clear_cache()

    def clear_cache(self) -> None:
        """Forget the moments of the last update, as a new graph numbers segments from scratch."""
        self._moments = no_moments()
        self._times_ns = np.zeros((0, 2), np.int64)

    def update(self, window: Window, graph: Graph, merged: Merged) -> Segments:
        """The segments of the window; only those that changed are computed."""
        points = window.points
        labels = points.fate.astype(np.int32)
        labels[window.accepted] = merged.labels[graph.state > 0]  # -1 is ISOLATED
        moments = segment_moments(graph.points, merged.labels, merged.previous, self._moments)
        times_ns = segment_times(points.times_ns, labels, merged.previous, self._times_ns)
        facts = np.column_stack(
            [moments["count"], moments["mean"], moments["covariance"], merged.aicc]
        )
        tracks = self._tracker.assign(points.arrival, labels, facts, merged.previous)
        self._moments, self._times_ns = moments, times_ns
        for column in (labels, tracks.ids):
            column.flags.writeable = False  # the next update builds on them
        model = graph.moments[merged.roots]
        return Segments(labels, merged.labels, moments, model, merged.aicc, times_ns, tracks)


def ellipsoid_records(segments: Segments, origin: Array) -> Ellipsoids:
    """The segments as ellipsoids in the world frame; origin (3,) m."""
    moments, model = segments.moments, segments.model
    planarity, cylindricality = moments["planarity"].copy(), moments["cylindricality"].copy()
    return Ellipsoids(
        count=moments["count"].astype(np.int64),
        mean=moments["mean"] + origin,
        covariance=matrices(moments["covariance"]),
        eigenvalues=moments["eigenvalues"][:, ::-1].copy(),
        axes=np.stack([moments[axis] for axis in ("v1", "v2", "v3")], axis=-1),
        planarity=planarity,
        cylindricality=cylindricality,
        sphericity=np.maximum(0.0, 1.0 - planarity - cylindricality),
        aicc=segments.aicc,
        model_mean=model["mean"] + origin,
        model_covariance=matrices(model["covariance"]),
    )


def matrices(components: Array) -> Array:
    """(s, 3, 3) symmetric matrices from (s, 6): xx, xy, xz, yy, yz, zz."""
    return np.asarray(components[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3))
