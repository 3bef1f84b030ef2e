"""Segments -> landmarks: the planes, lines and blobs of a window that can be found again."""

import math
from typing import NamedTuple

import numpy as np

from ellipseg_ros.config import LandmarksConfig
from ellipseg_ros.core.flat_moments import COUNT
from ellipseg_ros.core.members import Members, boxes, members
from ellipseg_ros.landmarks.blobs import compact, find_blobs
from ellipseg_ros.landmarks.fits import Fits, chosen, joined
from ellipseg_ros.landmarks.lines import find_lines
from ellipseg_ros.landmarks.planes import find_planes
from ellipseg_ros.records import DETERMINED, Array, Kind, SegmentAdjacency

LEVER = 5.0  # m: a registration error turns a landmark as if it differed over this length


class Found(NamedTuple):
    """The landmarks of a window; planes, then lines, then blobs."""

    kind: Array  # (l,) uint8, see Kind
    fits: Fits  # with what the registration adds to the covariance
    of_point: Array  # (n,) int32: the landmark of every point, -1 for none


def find_landmarks(
    points: Array, labels: Array, own: Array, adjacency: SegmentAdjacency, config: LandmarksConfig
) -> Found:
    """Choose the landmarks of a window.

    points (n, 3) m, local origin; labels (n,) int32: the segment of every point, negative for
    none; own (s, 24): moments of the segments' points; adjacency: which segments touch.
    """
    each = np.arange(len(own), dtype=np.int32)
    planes = find_planes(points, labels, own, adjacency, config)
    inside, around = members(labels, each, len(own)), boxes(points, labels, each, len(own))
    lines = find_lines(points, inside, own, around, planes.flat, config)
    taken = lines.taken
    taken[planes.points.rows] = True
    of_lines = np.bincount(labels[taken & (labels >= 0)], minlength=len(own))
    free = ~planes.flat & (of_lines < 0.5 * own[:, COUNT])
    blobs, of_blobs = find_blobs(points, labels, own, adjacency, free)
    good = compact(blobs, config)

    lots = [planes.fits, lines.fits, chosen(blobs, good)]
    kind = np.repeat(np.array(list(DETERMINED), np.uint8), [len(lot.count) for lot in lots])
    fits = joined(lots)
    of_point = np.full(len(points), -1, np.int32)
    _name(of_point, planes.points, 0)
    _name(of_point, lines.points, len(planes.fits.count))
    _name(of_point, _some(of_blobs, good), len(kind) - int(good.sum()))
    sure = _sure(kind, fits.covariance, config)
    _add_registration(kind, fits.covariance, config.registration_noise)
    names = np.append(np.where(sure, np.cumsum(sure) - 1, -1), -1).astype(np.int32)
    return Found(kind[sure], chosen(fits, sure), names[of_point])


def _some(inside: Members, good: Array) -> Members:
    counts = np.diff(inside.starts)
    return Members(np.append(0, np.cumsum(counts[good])), inside.rows[np.repeat(good, counts)])


def _name(of_point: Array, inside: Members, first: int) -> None:
    counts = np.diff(inside.starts)
    of_point[inside.rows] = first + np.repeat(np.arange(len(counts), dtype=np.int32), counts)


def _add_registration(kind: Array, covariance: Array, noise: float) -> None:
    """Add what is common to all points of a landmark, and so not in their scatter."""
    added = np.array([noise] * 3 + [noise / LEVER] * 3) ** 2
    for which, motions in DETERMINED.items():
        for motion in motions:
            covariance[kind == which, motion, motion] += added[motion]


def _sure(kind: Array, covariance: Array, config: LandmarksConfig) -> Array:
    """(l,) bool: whether the direction is known well enough."""
    variance = np.diagonal(covariance, axis1=1, axis2=2)
    limit = math.radians(config.max_angle) ** 2
    sure: Array = (kind == Kind.BLOB) | (variance[:, 3:].max(axis=1, initial=0.0) <= limit)
    return sure & np.isfinite(variance).all(axis=1)
