"""Which points are isolated, and the nearest neighbours of the others."""

from typing import NamedTuple

import numpy as np

from ellipseg_ros.config import GraphConfig
from ellipseg_ros.core import kdtree
from ellipseg_ros.data import Array


class Neighbours(NamedTuple):
    """The k nearest neighbours of every vertex of the graph, itself left out by its index.

    Ascending by (d^2, index), d^2 = (dx^2 + dy^2) + dz^2; -1 where there are fewer, and all -1 in
    the row of an isolated point.
    """

    rows: Array  # (n, k) int32
    isolated: Array  # (n,) bool: farther than the isolation distance from the nearest point


def find_neighbours(points: Array, config: GraphConfig) -> Neighbours:
    """Remove the isolated points, then find the neighbours of the rest among the rest.

    points: (n, 3) float64, m, finite. The paper finds neighbours first [choice: DESIGN 2.1].
    """
    tree = kdtree.build(points)
    rows = np.full((len(points), config.neighbours), -1, np.int32)
    squared = np.full(rows.shape, np.inf)
    kdtree.nearest(tree, np.ones(len(points), bool), rows, squared)
    isolated = squared[:, 0] > config.isolation_distance * config.isolation_distance
    if isolated.any():
        kdtree.hide(tree, isolated)
        met = isolated[rows].any(axis=1) & ~isolated  # row -1 may stand for one: only more work
        rows[isolated] = -1
        kdtree.nearest(tree, met, rows, squared)
    return Neighbours(rows, isolated)
