"""The record of an update, from what the stages give."""

from dataclasses import dataclass

import numpy as np

from ellipseg_ros.config import Config
from ellipseg_ros.core.segments import Segments, ellipsoid_records
from ellipseg_ros.core.window import Arrivals, Window
from ellipseg_ros.objects.stage import ObjectUpdate
from ellipseg_ros.records import Array, Landmarks, SegmentAdjacency, Segmentation


@dataclass(frozen=True)
class Cause:
    """Which update it is, and what happened before it."""

    sequence: int = 0
    restart: str = ""
    threshold_change: str = ""


def segmentation_record(  # a record of everything
    config: Config,
    window: Window,
    arrivals: Arrivals,
    segments: Segments,
    adjacency: SegmentAdjacency | None,
    objects: ObjectUpdate,
    landmarks: Landmarks | None,
    cause: Cause,
) -> Segmentation:
    """The segmentation of a window after an update."""
    points = window.points
    return Segmentation(
        labels=segments.labels,
        ellipsoids=ellipsoid_records(segments, window.origin),
        aicc=float(np.sum(segments.aicc)),
        criterion=config.criterion,
        threshold=config.tau,
        origin=window.origin,
        points=points.position,
        arrival=points.arrival,
        times_ns=points.times_ns,
        fields=window.fields,
        frame_id=window.frame_id,
        ids=segments.tracks.ids,
        state=segments.tracks.state,
        parents=segments.tracks.parents,
        removed=segments.tracks.removed,
        objects=objects.objects,
        removed_objects=objects.removed,
        adjacency=adjacency,
        landmarks=landmarks,
        first_seen_ns=segments.times_ns[:, 0],
        last_seen_ns=_newest(window.sight_ns, segments)
        if config.resolution > 0.0
        else segments.times_ns[:, 1],
        start_ns=window.start_ns,
        end_ns=window.end_ns,
        late=arrivals.late,
        evicted=arrivals.evicted,
        filtered=arrivals.filtered,
        unplaced=arrivals.unplaced,
        hits=window.hits,
        means=window.means,
        sweep=window.sweep,
        sweep_rows=window.sweep_rows,
        sequence=cause.sequence,
        restart=cause.restart,
        threshold_change=cause.threshold_change,
    )


def _newest(sight_ns: Array, segments: Segments) -> Array:
    """(s,) int64: time of the newest point of every segment."""
    newest, labels = segments.times_ns[:, 1].copy(), segments.labels
    inside = labels >= 0
    np.maximum.at(newest, labels[inside], sight_ns[inside])
    return newest
