"""The graph of one cloud, for tests of its parts."""

import numpy as np

from ellipseg_ros.config import GraphConfig
from ellipseg_ros.core.graph import Graph
from ellipseg_ros.core.window import Arrivals


def graph_of(points, config=None):
    """The graph of points (n, 3), rows as they are."""
    graph = Graph(config or GraphConfig())
    graph.update(Arrivals(points, np.arange(len(points)), np.zeros(0, np.int64)))
    return graph
