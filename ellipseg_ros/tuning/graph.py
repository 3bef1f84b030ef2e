"""What all thresholds of a window have in common, computed once, and the walk at each of them."""

from dataclasses import dataclass, replace

import numpy as np

from ellipseg_ros.config import Config
from ellipseg_ros.core.criteria import bias
from ellipseg_ros.core.edge_sorting import Edges, no_edges
from ellipseg_ros.core.edges import Renewed, update_edges
from ellipseg_ros.core.ellipsoids import COUNT, initial_ellipsoids, neighbour_masses
from ellipseg_ros.core.jit import alone, for_parts, helpers
from ellipseg_ros.core.merge import Merge, aicc_of
from ellipseg_ros.core.neighbours import Change, Neighbours
from ellipseg_ros.core.window import Window
from ellipseg_ros.records import Array, Sweep
from ellipseg_ros.tuning.curve import Curve

CHUNK = 3  # thresholds that a thread takes at a time, so that it steps down by little
NOBODY = np.zeros(0, np.int64)


@dataclass(frozen=True)
class Graph:
    """Vertices and edges of one window, before any merging; read only. Row i is point i."""

    change: Change  # as if all points had just arrived
    nodes: Array  # (n, 24): initial ellipsoids
    masses: Array  # (n,) m^2
    edges: Edges

    @property
    def points(self) -> int:
        """The number of vertices: of the points that are not isolated."""
        return int(np.count_nonzero(self.change.member))

    def singletons_aicc(self, config: Config) -> float:
        """AICc of the model in which every vertex is a segment of its own."""
        aicc = np.zeros(len(self.nodes))
        vertices = np.flatnonzero(self.change.member)
        aicc_of(self.nodes, vertices, config.model.noise_variance, aicc)
        return float(np.sum(aicc[vertices]))


def graph_of(points: Array, config: Config, origin: Array | None = None) -> Graph:
    """The graph of points (n, 3), m, by the stages of `segment`; with the same arguments."""
    config = replace(config, max_points_per_second=0, max_points=0)
    push = Window(origin).push(Sweep(stamp_ns=0, points=points), config)
    count = len(push.arrived)
    neighbours, merge = Neighbours(config.graph), Merge()
    neighbours.renumber(NOBODY, count)
    merge.renumber(NOBODY, count)
    change = neighbours.update(push.arrived, push.serial, push.expired)
    vertices = np.flatnonzero(change.dirty)
    initial_ellipsoids(neighbours.points, neighbours.rows, vertices, merge.nodes)
    neighbour_masses(neighbours.points, neighbours.rows, vertices, merge.masses)
    edges = update_edges(no_edges(), Renewed.after(change, neighbours.rows, merge.nodes))
    return Graph(change, merge.nodes[:count].copy(), merge.masses[:count].copy(), edges)


def sweep(graph: Graph, config: Config, thresholds: Array) -> Curve:
    """Segment a graph at every threshold (t,); `config` says all the rest.

    Each AICc is that of `segment` bit for bit, on any number of threads.
    """
    ascending = np.unique(np.asarray(thresholds, dtype=np.float64))
    aicc, biases = np.empty((2, len(ascending)))
    count = np.empty(len(ascending), np.int64)
    # From the top down: a lower threshold leaves much as it was (core/merge.py).
    left = iter([range(max(k - CHUNK, 0), k) for k in range(len(ascending), 0, -CHUNK)])

    def work(*_: int) -> None:
        with alone():  # the other threads walk, too
            walker: Walker | None = None
            for chunk in left:
                walker = walker or Walker(graph)
                for row in reversed(chunk):
                    at = replace(config, threshold=float(ascending[row]))
                    aicc[row], biases[row], count[row] = walker.walk(at)

    for_parts([(k, k + 1) for k in range(helpers() + 1)], work)
    singletons = graph.singletons_aicc(config)
    return Curve(config.criterion, graph.points, singletons, ascending, aicc, biases, count)


class Walker:
    """One forest over a graph, for one thread; quick where each threshold is below the last."""

    def __init__(self, graph: Graph) -> None:
        self._graph = graph
        self._change = graph.change
        self._merge = Merge()
        self._merge.renumber(NOBODY, len(graph.nodes))
        self._merge.nodes[: len(graph.nodes)] = graph.nodes

    def walk(self, config: Config) -> tuple[float, float, int]:
        """AICc, its bias term, and the number of segments under these settings."""
        if config.criterion == "density":
            self._merge.masses[: len(self._graph.masses)] = self._graph.masses
        remerge = self._merge.widened(self._change, config)
        merged = self._merge.update(self._graph.edges, self._change, remerge)
        nothing = np.zeros_like(self._change.member)
        self._change = Change(nothing, nothing, self._change.member)
        sizes, times = np.unique(self._merge.nodes[merged.roots, COUNT], return_counts=True)
        biases = np.array([bias(size) for size in sizes])
        return float(np.sum(merged.aicc)), float(np.sum(times * biases)), len(merged.roots)
