"""Detection of landmarks: planes, lines and blobs of a window that can be observed again."""

import math
from typing import NamedTuple

import numpy as np

from ellipseg_ros.config import LandmarksConfig
from ellipseg_ros.core.members import group_boxes, group_members
from ellipseg_ros.landmarks.blobs import find_blobs
from ellipseg_ros.landmarks.fits import Fits, concatenate_fits, renumber
from ellipseg_ros.landmarks.lines import find_lines
from ellipseg_ros.landmarks.planes import find_planes
from ellipseg_ros.records import DETERMINED, Array, Kind, SegmentAdjacency

LEVER_ARM = 5.0  # m: a registration error rotates a landmark as if it differed over this length
MAX_LINE_SHARE = 0.5  # of a segment's points that are of lines, if it may be part of a blob


class Detections(NamedTuple):
    """The landmarks of a window; planes, then lines, then blobs."""

    kind: Array  # (l,) uint8, see Kind
    fits: Fits  # their covariance includes the registration noise
    point_labels: Array  # (n,) int32: the landmark of every point, -1 for none


def find_landmarks(
    points: Array,
    labels: Array,
    moments: Array,
    adjacency: SegmentAdjacency,
    config: LandmarksConfig,
) -> Detections:
    """Detect the landmarks of a window.

    points (n, 3) m, local origin; labels (n,) int32: the segment of every point, negative for
    none; moments (s,): of the segments' points.
    """
    segments = len(moments)
    planes = find_planes(points, labels, moments, adjacency, config)
    members = group_members(labels, segments)
    around = group_boxes(points, labels, segments)
    lines = find_lines(points, members, moments, around, planes.broad, config)
    taken = lines.taken | (planes.point_labels >= 0)
    share = np.bincount(labels[taken & (labels >= 0)], minlength=segments)
    free = ~planes.broad & (share < MAX_LINE_SHARE * moments["count"])
    blobs, blob_labels = find_blobs(points, labels, moments, adjacency, free, config)

    parts = [planes.fits, lines.fits, blobs]
    counts = [len(part.count) for part in parts]
    kind, fits = np.repeat(np.array(list(DETERMINED), np.uint8), counts), concatenate_fits(parts)
    point_labels, first = planes.point_labels, counts[0]
    for more, count in ((lines.point_labels, counts[1]), (blob_labels, counts[2])):
        point_labels = np.where(more >= 0, first + more, point_labels)
        first += count
    precise = _is_precise(kind, fits.covariance, config)
    _add_registration_noise(kind, fits.covariance, config.registration_noise)
    return Detections(kind[precise], fits.select(precise), renumber(point_labels, precise))


def _add_registration_noise(kind: Array, covariance: Array, noise: float) -> None:
    """Add the error that all points of a landmark share, and that is not in their scatter."""
    added = np.array([noise] * 3 + [noise / LEVER_ARM] * 3) ** 2
    for each, motions in DETERMINED.items():
        for motion in motions:
            covariance[kind == each, motion, motion] += added[motion]


def _is_precise(kind: Array, covariance: Array, config: LandmarksConfig) -> Array:
    """(l,) bool: whether the direction is known well enough."""
    variance = np.diagonal(covariance, axis1=1, axis2=2)
    limit = math.radians(config.max_angle) ** 2
    precise: Array = (kind == Kind.BLOB) | (variance[:, 3:].max(axis=1, initial=0.0) <= limit)
    return precise & np.isfinite(variance).all(axis=1)
