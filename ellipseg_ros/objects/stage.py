"""The objects of a window, with persistent ids."""

from typing import NamedTuple

import numpy as np

from ellipseg_ros.config import ObjectsConfig
from ellipseg_ros.core.graph import Graph
from ellipseg_ros.core.members import groups_of_points
from ellipseg_ros.core.segments import Segments, matrices
from ellipseg_ros.core.tracking import Tracker, Tracks
from ellipseg_ros.core.window import Window
from ellipseg_ros.objects.finder import Grouping, find_objects
from ellipseg_ros.records import Array, Objects, SegmentAdjacency


class ObjectUpdate(NamedTuple):
    """The objects after an update."""

    objects: Objects | None  # None: not enabled
    removed: Array  # (r,) uint32: ids of the previous update that ended


class ObjectStage:
    """Groups segments into objects; keeps their ids from update to update."""

    def __init__(self) -> None:
        self._tracker = Tracker()

    def reset(self) -> None:
        """End all objects: the next update lists them as removed. Ids go on."""
        self._tracker.reset()

    def update(
        self,
        window: Window,
        graph: Graph,
        segments: Segments,
        adjacency: SegmentAdjacency | None,
        config: ObjectsConfig,
    ) -> ObjectUpdate:
        """The objects of the window; without adjacency, or not enabled: none."""
        if adjacency is None or not config.enabled:
            return ObjectUpdate(None, self._tracker.end())
        labels, moments = segments.vertex_labels, segments.moments
        grouping = find_objects(graph.points, graph.moments, labels, moments, adjacency, config)
        labels = groups_of_points(segments.labels, grouping.segment_labels)
        moments = grouping.moments
        features = np.column_stack([moments["count"], moments["mean"], moments["covariance"]])
        tracks = self._tracker.assign(window.points.arrival, labels, features)
        for column in (labels, tracks.ids):
            column.flags.writeable = False  # the next update builds on them
        return ObjectUpdate(object_records(grouping, tracks, window.origin), tracks.removed)


def object_records(grouping: Grouping, tracks: Tracks, origin: Array) -> Objects:
    """The objects in the world frame; origin (3,) m."""
    moments = grouping.moments
    planarity, cylindricality = (moments[name].copy() for name in ("planarity", "cylindricality"))
    return Objects(
        segment_labels=grouping.segment_labels,
        count=moments["count"].astype(np.int64),
        mean=moments["mean"] + origin,
        covariance=matrices(moments["covariance"]),
        box_min=grouping.boxes.low + origin,
        box_max=grouping.boxes.high + origin,
        planarity=planarity,
        cylindricality=cylindricality,
        sphericity=np.maximum(0.0, 1.0 - planarity - cylindricality),
        hierarchy=grouping.hierarchy,
        ids=tracks.ids,
        state=tracks.state,
        parents=tracks.parents,
    )
