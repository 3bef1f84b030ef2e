"""Checks of a segmentation: counts add up, numbers are finite, and messages can be read."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from ellipseg_ros.config import Config
from ellipseg_ros.core.coordinates import MAX_COORDINATE_M
from ellipseg_ros.io.bag import node_types
from ellipseg_ros.io.messages import MarkerStream, write_landmarks, write_segments
from ellipseg_ros.io.pointcloud2 import write_labelled
from ellipseg_ros.io.topics import BAG_TOPICS
from ellipseg_ros.records import REJECTED, SECOND, THINNED, Segmentation, Sweep

FINITE = {  # columns that must be finite, by record
    "ellipsoids": (
        *("mean", "covariance", "eigenvalues", "axes", "planarity", "cylindricality"),
        *("sphericity", "aicc", "model_mean", "model_covariance"),
    ),
    "objects": (
        "mean",
        "covariance",
        "box_min",
        "box_max",
        "planarity",
        "cylindricality",
        "sphericity",
    ),
    "landmarks": ("position", "axes", "sigma", "box_min", "box_max", "covariance", "instability"),
}


def contradictions(
    before: Segmentation | None, group: Sweep, update: Segmentation, config: Config
) -> Iterator[str]:
    """Yield a description of everything that is wrong in the update by `group`.

    before: the last update of the same window; None if the window starts with this one.
    """
    points, segments = len(update.points), len(update.ids)
    counts = update.counts
    if counts.segmented + counts.isolated + counts.rejected + counts.thinned != points:
        yield f"{points} points in the window, but {counts}"
    if update.labels.min(initial=0) < THINNED or update.labels.max(initial=-1) >= segments:
        yield "labels of segments that do not exist"
    tally = np.bincount(update.labels[update.labels >= 0], minlength=segments)
    if not np.array_equal(tally, update.ellipsoids.count):
        yield "counts of the segments differ from those of the labels"
    valid = (np.abs(update.points) <= MAX_COORDINATE_M).all(axis=1)  # false for NaN
    if (valid == (update.labels == REJECTED)).any():
        yield "rejected points are not those that are not finite or too far away"
    expected = _expected_points(before, group, update, config)
    if expected != points:
        yield f"{expected} points should be in the window; it has {points}"
    yield from _not_finite(update)


def _expected_points(
    before: Segmentation | None, group: Sweep, update: Segmentation, config: Config
) -> int:
    """Number of points in the window by what was there, what arrived, and what was dropped."""
    start = update.end_ns - round(config.window_duration * SECOND)
    kept = 0 if before is None else int((before.times_ns > start).sum())
    return kept + len(group) - update.late - update.evicted


def _not_finite(update: Segmentation) -> Iterator[str]:
    if not np.isfinite(update.aicc):
        yield f"the AICc is {update.aicc}"
    for name, columns in FINITE.items():
        record = getattr(update, name)
        for column in columns if record is not None else ():
            if not np.isfinite(getattr(record, column)).all():
                yield f"{column} of the {name} is not finite"


def unreadable(update: Segmentation, markers: MarkerStream) -> Iterator[str]:
    """Yield a description of everything that is wrong in the messages of an update."""
    cloud = _decoded("/segmented_points", write_labelled(update))
    if cloud.width != len(update.points) or len(cloud.data) != cloud.row_step:
        yield f"segmented_points has {cloud.width} points, the window {len(update.points)}"
    shapes = _decoded("/ellipsoids", markers.update(update)).markers
    poses = [(m.pose.position.x, m.pose.position.y, m.pose.position.z, m.scale.x) for m in shapes]
    if not np.isfinite(np.array(poses)).all():
        yield "a marker is not finite"
    message = _decoded("/segments", write_segments(update))
    if [segment.id for segment in message.segments] != sorted(update.ids.tolist()):
        yield "segments has other ids than the update"
    if update.landmarks is not None:
        message = _decoded("/landmarks", write_landmarks(update, update.landmarks))
        if len(message.landmarks) != len(update.landmarks):
            yield "landmarks has another number of landmarks than the update"


def _decoded(topic: str, message: bytes) -> Any:
    return node_types().deserialize_cdr(message, BAG_TOPICS[topic].type)
