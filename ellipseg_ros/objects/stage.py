"""The objects of a window, with persistent ids."""

from typing import NamedTuple

import numpy as np

from ellipseg_ros.config import ObjectsConfig
from ellipseg_ros.core.graph import Graph
from ellipseg_ros.core.moments import flat
from ellipseg_ros.core.segments import Segments, matrices
from ellipseg_ros.core.tracking import Tracker, Tracks
from ellipseg_ros.core.window import Window
from ellipseg_ros.objects.finder import Level, find_objects
from ellipseg_ros.records import Array, Objects, SegmentAdjacency


class ObjectUpdate(NamedTuple):
    """The objects after an update."""

    objects: Objects | None  # None: not enabled
    removed: Array  # (r,) uint32: ids that the last update had and this one has not


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
        level = find_objects(
            graph.points,
            flat(graph.moments),
            segments.vertex_labels,
            flat(segments.moments),
            adjacency,
            config,
        )
        labels = np.append(level.of_segment, np.int32(-1))[np.maximum(segments.labels, -1)]
        facts = np.column_stack([level.nodes[:, :4], level.nodes[:, 18:]])
        tracks = self._tracker.assign(window.points.arrival, labels, facts)
        for column in (labels, tracks.ids):
            column.flags.writeable = False  # the next update builds on them
        return ObjectUpdate(object_records(level, tracks, window.origin), tracks.removed)


def object_records(level: Level, tracks: Tracks, origin: Array) -> Objects:
    """The objects in the world frame; origin (3,) m."""
    nodes = level.nodes
    planarity, cylindricality = nodes[:, 10].copy(), nodes[:, 11].copy()
    return Objects(
        segment_labels=level.of_segment,
        count=nodes[:, 0].astype(np.int64),
        mean=nodes[:, 1:4] + origin,
        covariance=matrices(nodes[:, 18:]),
        box_min=level.low + origin,
        box_max=level.high + origin,
        planarity=planarity,
        cylindricality=cylindricality,
        sphericity=np.maximum(0.0, 1.0 - planarity - cylindricality),
        hierarchy=level.hierarchy,
        ids=tracks.ids,
        state=tracks.state,
        parents=tracks.parents,
    )
