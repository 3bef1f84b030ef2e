"""Clouds with truth: a class for every point, and perhaps which thing it belongs to."""

from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from typing import Any

import numpy as np

from ellipseg_ros.records import Array
from studies.partition.metrics import UNKNOWN

NEIGHBOURS = 10  # of the graph on which boundaries are measured
SEARCH = "scipy.spatial"
NONE = -1  # label of a point without a segment


@dataclass(frozen=True)
class Scan:
    """A cloud and its truth; row i of every array is point i."""

    name: str
    simulated: bool
    points: Array  # (n, 3) float64 m
    classes: Array  # (n,) int64, see Class; 0: not known
    instances: Array | None  # (n,) int64, 0: no thing; None: not told for every thing

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
    """Pairs of which one is among the 10 nearest of the other: (n, 3) m -> (m, 2), i < j."""
    wanted = min(NEIGHBOURS + 1, len(points))
    _, near = tree(points).query(points, wanted, workers=-1)
    here = np.repeat(np.arange(len(points)), wanted)
    pairs = np.sort(np.column_stack([here, near.reshape(-1)]), axis=1)
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    code = np.unique(pairs[:, 0] * len(points) + pairs[:, 1])
    return np.column_stack([code // len(points), code % len(points)])


def tree(points: Array) -> Any:
    """The kd-tree of scipy, so that truth does not hang on what is judged by it.

    Imported here, since of all commands this one alone needs scipy.
    """
    return import_module(SEARCH).cKDTree(points)


def completed(labels: Array, points: Array) -> Array:
    """Labels in which every point has a segment: its own, or that of the nearest that has one.

    labels: (n,) integers, negative for none. If none has one, all are in segment 0.
    """
    has = labels >= 0
    if not has.any():
        return np.zeros(len(labels), np.int64)
    full = labels.astype(np.int64)
    if not has.all():
        _, nearest = tree(points[has]).query(points[~has], workers=-1)
        full[~has] = full[has][nearest]
    return full
