"""Labelled clouds: a class for every point, and perhaps the instance it belongs to."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from ellipseg_ros.records import Array
from studies.partition.metrics import UNKNOWN

NEIGHBOURS = 10  # of the graph on which boundaries are measured


@dataclass(frozen=True)
class Scan:
    """A cloud and its truth; row i of every array is point i."""

    name: str
    simulated: bool
    points: Array  # (n, 3) float64 m
    classes: Array  # (n,) int64, see Class; 0: unknown
    instances: Array | None  # (n,) int64, 0: ground; None: not known for every point

    def __len__(self) -> int:
        return len(self.points)

    @property
    def known(self) -> Array:
        """(n,) bool: the class is known."""
        return self.classes != UNKNOWN

    @cached_property
    def edges(self) -> Array:
        """(m, 2) pairs of neighbours."""
        return neighbour_edges(self.points)


def neighbour_edges(points: Array) -> Array:
    """Pairs of which one is among the 10 nearest of the other: (n, 3) m -> (m, 2), i < j.

    By scipy's kd-tree, so that the evaluation is independent of the search that it judges.
    """
    count = min(NEIGHBOURS + 1, len(points))
    _, near = cKDTree(points).query(points, count, workers=-1)
    here = np.repeat(np.arange(len(points)), count)
    pairs = np.sort(np.column_stack([here, near.reshape(-1)]), axis=1)
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    code = np.unique(pairs[:, 0] * len(points) + pairs[:, 1])
    return np.column_stack([code // len(points), code % len(points)])


def completed(labels: Array, points: Array) -> Array:
    """Labels in which a point without a segment has that of the nearest point with one.

    labels: (n,) integers, negative for no segment. If no point has one, all are in segment 0.
    """
    has = labels >= 0
    if not has.any():
        return np.zeros(len(labels), np.int64)
    full = labels.astype(np.int64)
    if not has.all():
        _, nearest = cKDTree(points[has]).query(points[~has], workers=-1)
        full[~has] = full[has][nearest]
    return full
