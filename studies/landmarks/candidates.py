"""Candidates for landmarks: those of this package, ellipsoids, and Gaussians of a voxel grid."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from ellipseg_ros.config import Config, LandmarksConfig, ObjectsConfig
from ellipseg_ros.core.criteria import CRITERIA
from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.records import Array, Kind, Landmarks
from ellipseg_ros.segmenter import segment

MIN_POINTS = 12  # of a Gaussian
BOX_SIGMA = 2.0  # half edges of a Gaussian's box in standard deviations
# Thresholds by criterion.
LEAST_AICC = {name: criterion.default_threshold for name, criterion in CRITERIA.items()}
COARSE = {"shape": 20.0, "density": 6.0, "parsimony": 20_000.0}
VOXEL_SIZES = (0.5, 1.0)  # m
SEGMENTS_ONLY = Config(
    objects=ObjectsConfig(enabled=False), landmarks=LandmarksConfig(enabled=False)
)


class Gaussians(NamedTuple):
    """Moments of sets of points."""

    count: Array  # (g,) int64
    mean: Array  # (g, 3) m
    covariance: Array  # (g, 3, 3) m^2
    point_labels: Array  # (n,) int: the set of every point, negative for none


class Method(NamedTuple):
    """A way to extract landmarks from a cloud."""

    name: str
    extract: Callable[[Array], Landmarks]  # points (n, 3) m


def our_landmarks(points: Array, config: Config | None = None) -> Landmarks:
    """The landmarks of this package."""
    landmarks = segment(points, config).landmarks
    if landmarks is None:
        raise EllipsegError("landmarks.enabled is false; it must be true")
    return landmarks


def merged_ellipsoids(points: Array, criterion: str, threshold: float) -> Landmarks:
    """Every segment as a landmark."""
    config = replace(SEGMENTS_ONLY, criterion=criterion, threshold=threshold)
    segmentation = segment(points, config)
    shape = segmentation.ellipsoids
    moments = Gaussians(shape.count, shape.mean, shape.covariance, segmentation.labels)
    return as_landmarks(moments)


def initial_ellipsoids(points: Array) -> Landmarks:
    """Every point with its nearest neighbours as a landmark."""
    segmentation = segment(points, replace(SEGMENTS_ONLY, threshold=0.0))
    shape = segmentation.ellipsoids
    count = np.full(len(shape), MIN_POINTS)  # about the size of a neighbourhood
    moments = Gaussians(count, shape.model_mean, shape.model_covariance, segmentation.labels)
    return as_landmarks(moments)


def voxel_gaussians(points: Array, size: float) -> Landmarks:
    """The points of every voxel as a landmark; size in m."""
    _, voxel, count = np.unique(
        np.floor(points / size).astype(np.int64), axis=0, return_inverse=True, return_counts=True
    )
    voxel = voxel.reshape(-1)
    mean = _sums(points, voxel, len(count)) / count[:, None]
    deviation = points - mean[voxel]
    products = np.einsum("ni,nj->nij", deviation, deviation).reshape(-1, 9)
    covariance = _sums(products, voxel, len(count)) / count[:, None]
    return as_landmarks(Gaussians(count, mean, covariance.reshape(-1, 3, 3), voxel))


def _sums(values: Array, group: Array, count: int) -> Array:
    return np.column_stack([np.bincount(group, column, count) for column in values.T])


def as_landmarks(gaussians: Gaussians) -> Landmarks:
    """Gaussians of MIN_POINTS or more as landmarks, without covariances (zeros).

    The greatest of planarity, cylindricality and sphericity (paper, eqs. 3-5) gives the kind.
    """
    kept = np.flatnonzero(gaussians.count >= MIN_POINTS)
    values, axes = np.linalg.eigh(gaussians.covariance[kept])
    values, axes = np.maximum(values[:, ::-1], 0.0), axes[:, :, ::-1].copy()
    axes[:, :, 2] *= np.sign(np.linalg.det(axes))[:, None]
    e1, e2, e3 = values.T
    shape = np.column_stack([2.0 * (e2 - e3), e1 - e2, 3.0 * e3])
    kinds = np.array([Kind.PLANE, Kind.LINE, Kind.BLOB], np.uint8)
    sigma = np.sqrt(values)
    rank = np.full(len(gaussians.count) + 1, -1, np.int32)
    rank[kept] = np.arange(len(kept))
    return Landmarks(
        ids=np.arange(1, len(kept) + 1, dtype=np.uint32),
        kind=kinds[np.argmax(shape, axis=1)],
        count=gaussians.count[kept],
        position=gaussians.mean[kept],
        axes=axes,
        sigma=sigma,
        box_min=-BOX_SIGMA * sigma,
        box_max=BOX_SIGMA * sigma,
        covariance=np.zeros((len(kept), 6, 6)),
        instability=np.zeros(len(kept)),
        first_seen_ns=np.zeros(len(kept), np.int64),
        point_labels=rank[np.maximum(gaussians.point_labels, -1)],
    )


OURS = Method("landmarks", our_landmarks)
GRIDS = [
    Method(f"voxels of {size:g} m", partial(voxel_gaussians, size=size)) for size in VOXEL_SIZES
]
ELLIPSOIDS = [
    Method(
        f"ellipsoids, {criterion}, {text}",
        partial(merged_ellipsoids, criterion=criterion, threshold=thresholds[criterion]),
    )
    for text, thresholds in (("least AICc", LEAST_AICC), ("coarse", COARSE))
    for criterion in CRITERIA
]
OTHERS = [*ELLIPSOIDS, Method("initial ellipsoids", initial_ellipsoids), *GRIDS]
