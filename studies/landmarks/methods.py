"""Things that could be landmarks: ours, ellipsoids, and Gaussians of a grid."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from ellipseg_ros.config import Config, LandmarksConfig, ObjectsConfig
from ellipseg_ros.core.criteria import CRITERIA
from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.records import Array, Kind, Landmarks, Segmentation
from ellipseg_ros.segmenter import segment

LEAST = 12  # points of a Gaussian
BOX = 2.0  # standard deviations: half edges of a Gaussian's box
COARSE = {"shape": 20.0, "density": 6.0, "parsimony": 20_000.0}
VOXELS = (0.5, 1.0)  # m
ALONE = Config(objects=ObjectsConfig(enabled=False), landmarks=LandmarksConfig(enabled=False))


class Gaussians(NamedTuple):
    """Moments of sets of points."""

    count: Array  # (g,) int64
    mean: Array  # (g, 3) m
    covariance: Array  # (g, 3, 3) m^2
    of_point: Array  # (n,) int: the set of every point, negative for none


class Method(NamedTuple):
    """A way to find landmarks in a cloud."""

    name: str
    find: Callable[[Array], Landmarks]  # points (n, 3) m


def our_landmarks(points: Array, config: Config | None = None) -> Landmarks:
    """The landmarks of this package."""
    found = segment(points, config)
    if found.landmarks is None:
        raise EllipsegError("landmarks.enabled is false; it must be true")
    return found.landmarks


def merged_ellipsoids(points: Array, criterion: str, threshold: float) -> Landmarks:
    """Every segment as a landmark."""
    found = segment(points, replace(ALONE, criterion=criterion, threshold=threshold))
    shape = found.ellipsoids
    return as_landmarks(Gaussians(shape.count, shape.mean, shape.covariance, found.labels))


def initial_ellipsoids(points: Array) -> Landmarks:
    """Every point with its nearest neighbours as a landmark."""
    found: Segmentation = segment(points, replace(ALONE, threshold=0.0))
    shape = found.ellipsoids
    many = np.full(len(shape), LEAST)  # as many points as have a neighbourhood, about
    return as_landmarks(Gaussians(many, shape.model_mean, shape.model_covariance, found.labels))


def voxels(points: Array, edge: float) -> Landmarks:
    """The points of every cell of a grid as a landmark; edge, m."""
    _, cell, count = np.unique(
        np.floor(points / edge).astype(np.int64), axis=0, return_inverse=True, return_counts=True
    )
    cell = cell.reshape(-1)
    mean = _sums(points, cell, len(count)) / count[:, None]
    apart = points - mean[cell]
    products = np.einsum("ni,nj->nij", apart, apart).reshape(-1, 9)
    covariance = _sums(products, cell, len(count)) / count[:, None]
    return as_landmarks(Gaussians(count, mean, covariance.reshape(-1, 3, 3), cell))


def _sums(values: Array, group: Array, count: int) -> Array:
    return np.column_stack([np.bincount(group, column, count) for column in values.T])


def as_landmarks(what: Gaussians) -> Landmarks:
    """Gaussians of LEAST points or more as landmarks of the kind that their shape is nearest to.

    Planarity, cylindricality or sphericity (paper, eqs. 3-5): the greatest of the three decides.
    """
    kept = np.flatnonzero(what.count >= LEAST)
    values, axes = np.linalg.eigh(what.covariance[kept])
    values, axes = np.maximum(values[:, ::-1], 0.0), axes[:, :, ::-1].copy()
    axes[:, :, 2] *= np.sign(np.linalg.det(axes))[:, None]
    e1, e2, e3 = values.T
    shares = np.column_stack([2.0 * (e2 - e3), e1 - e2, 3.0 * e3])
    kinds = np.array([Kind.PLANE, Kind.LINE, Kind.BLOB], np.uint8)
    sigma = np.sqrt(values)
    rank = np.full(len(what.count) + 1, -1, np.int32)
    rank[kept] = np.arange(len(kept))
    return Landmarks(
        ids=np.arange(1, len(kept) + 1, dtype=np.uint32),
        kind=kinds[np.argmax(shares, axis=1)],
        count=what.count[kept],
        position=what.mean[kept],
        axes=axes,
        sigma=sigma,
        box_min=-BOX * sigma,
        box_max=BOX * sigma,
        covariance=np.zeros((len(kept), 6, 6)),  # nobody knows
        stability=np.zeros(len(kept)),
        first_seen_ns=np.zeros(len(kept), np.int64),
        point_labels=rank[np.maximum(what.of_point, -1)],
    )


DEFAULTS = {name: criterion.default_threshold for name, criterion in CRITERIA.items()}
OURS = Method("landmarks", our_landmarks)
GRIDS = [Method(f"voxels of {edge:g} m", partial(voxels, edge=edge)) for edge in VOXELS]
OTHERS = [
    *(
        Method(f"ellipsoids, {name}, {what}", partial(_find, criterion=name, threshold=at[name]))
        for _find in [merged_ellipsoids]
        for what, at in (("least AICc", DEFAULTS), ("coarse", COARSE))
        for name in CRITERIA
    ),
    Method("initial ellipsoids", initial_ellipsoids),
    *GRIDS,
]
