"""Whether an update accounts for every point, holds finite numbers only, and can be read back."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from ellipseg_ros.config import Config
from ellipseg_ros.core.window import LARGEST
from ellipseg_ros.io.bag import node_types
from ellipseg_ros.io.messages import MarkerStream, write_landmarks, write_segments
from ellipseg_ros.io.pointcloud2 import write_labelled
from ellipseg_ros.io.topics import BAG_TOPICS
from ellipseg_ros.records import REJECTED, SECOND, THINNED, Segmentation, Sweep

NUMBERS = {  # that must be finite, by record
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
    "landmarks": ("position", "axes", "sigma", "box_min", "box_max", "covariance", "stability"),
}


def faults(
    before: Segmentation | None, group: Sweep, found: Segmentation, config: Config
) -> Iterator[str]:
    """Yield, in words, what is wrong with the update that `group` made.

    before: the last update of the same window; None if the window begins with this one.
    """
    there, segments = len(found.points), len(found.ids)
    counts = found.counts
    if counts.segmented + counts.isolated + counts.rejected + counts.thinned != there:
        yield f"{there} points in the window, but {counts}"
    if found.labels.min(initial=0) < THINNED or found.labels.max(initial=-1) >= segments:
        yield "labels that no segment has"
    tally = np.bincount(found.labels[found.labels >= 0], minlength=segments)
    if not np.array_equal(tally, found.ellipsoids.count):
        yield "counts of the segments are not those of the labels"
    good = (np.abs(found.points) <= LARGEST).all(axis=1)  # NaN is not
    if (good == (found.labels == REJECTED)).any():
        yield "rejected points are not those that are not finite, or too far"
    expected = _expected(before, group, found, config)
    if expected != there:
        yield f"{expected} points should be in the window; it has {there}"
    yield from _not_finite(found)


def _expected(
    before: Segmentation | None, group: Sweep, found: Segmentation, config: Config
) -> int:
    """How many points the window must have, by what came, and by what is said of the others."""
    start = found.end_ns - round(config.window_duration * SECOND)
    stayed = 0 if before is None else int((before.times_ns > start).sum())
    return stayed + len(group) - found.late - found.evicted


def _not_finite(found: Segmentation) -> Iterator[str]:
    if not np.isfinite(found.aicc):
        yield f"the AICc is {found.aicc}"
    for name, columns in NUMBERS.items():
        record = getattr(found, name)
        for column in columns if record is not None else ():
            if not np.isfinite(getattr(record, column)).all():
                yield f"{column} of the {name} is not finite"


def unreadable(found: Segmentation, markers: MarkerStream) -> Iterator[str]:
    """Yield what is wrong with the serialized messages of an update."""
    cloud = _decoded("/segmented_points", write_labelled(found))
    if cloud.width != len(found.points) or len(cloud.data) != cloud.row_step:
        yield f"segmented_points has {cloud.width} points, the window {len(found.points)}"
    shown = _decoded("/ellipsoids", markers.update(found)).markers
    poses = [(m.pose.position.x, m.pose.position.y, m.pose.position.z, m.scale.x) for m in shown]
    if not np.isfinite(np.array(poses)).all():
        yield "a marker is not finite"
    told = _decoded("/segments", write_segments(found))
    if [one.id for one in told.segments] != sorted(found.ids.tolist()):
        yield "segments lists other ids than there are"
    if found.landmarks is not None:
        marks = _decoded("/landmarks", write_landmarks(found, found.landmarks)).landmarks
        if len(marks) != len(found.landmarks):
            yield "landmarks lists others than there are"


def _decoded(topic: str, message: bytes) -> Any:
    return node_types().deserialize_cdr(message, BAG_TOPICS[topic].type)
