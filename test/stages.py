"""The first stages alone, on one cloud, for tests of what they leave behind."""

from typing import NamedTuple

import numpy as np

from ellipseg_ros.config import GraphConfig
from ellipseg_ros.core.edge_sorting import Edges, no_edges
from ellipseg_ros.core.edges import Renewed, update_edges
from ellipseg_ros.core.ellipsoids import WIDTH, initial_ellipsoids
from ellipseg_ros.core.neighbours import ISOLATED, Change, Neighbours

NOBODY = np.zeros(0, np.int64)


class Graph(NamedTuple):
    neighbours: Neighbours
    isolated: np.ndarray
    nodes: np.ndarray
    edges: Edges


def first_change(points, neighbours):
    neighbours.renumber(NOBODY, len(points))
    return neighbours.update(points, np.arange(len(points)), NOBODY)


def graph_of(points):
    """The graph of points (n, 3), rows as they are."""
    neighbours = Neighbours(GraphConfig())
    change: Change = first_change(points, neighbours)
    nodes = np.empty((2 * len(points), WIDTH))
    rows = np.flatnonzero(change.dirty)
    initial_ellipsoids(points, neighbours.rows, rows, nodes)
    edges = update_edges(no_edges(), Renewed.after(change, neighbours.rows, nodes))
    return Graph(neighbours, neighbours.status == ISOLATED, nodes, edges)
