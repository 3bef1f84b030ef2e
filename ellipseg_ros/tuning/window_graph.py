"""The graph of one window, and the AICc of its segmentation at many thresholds."""

from dataclasses import dataclass, replace

import numpy as np

from ellipseg_ros.config import Config
from ellipseg_ros.core.criteria import aicc_bias, rule_of, segments_aicc
from ellipseg_ros.core.graph import Graph, GraphChange
from ellipseg_ros.core.jit import for_parts, helpers, single_threaded
from ellipseg_ros.core.merge import Merge
from ellipseg_ros.core.window import Window
from ellipseg_ros.records import Array, Sweep
from ellipseg_ros.tuning.curve import Curve

THRESHOLDS_PER_CHUNK = 3  # that a thread takes at a time, so that it lowers them in small steps


@dataclass(frozen=True)
class WindowGraph:
    """The graph of one window before any merge, which all thresholds share; read only."""

    graph: Graph
    change: GraphChange  # all points as arrivals


def window_graph(points: Array, config: Config, origin: Array | None = None) -> WindowGraph:
    """The graph of points (n, 3), m, as `segment` makes it; with the same arguments."""
    config = replace(config, max_points_per_second=0, max_points=0)
    graph = Graph(config.graph)
    change = graph.update(Window(origin).push(Sweep(stamp_ns=0, points=points), config))
    return WindowGraph(graph, change)


def threshold_curve(window: WindowGraph, config: Config, thresholds: Array) -> Curve:
    """Segment a window at every threshold (t,); `config` gives everything else.

    Each AICc is that of `segment` bit for bit, on any number of threads.
    """
    ascending = np.unique(np.asarray(thresholds, dtype=np.float64))
    aicc, bias = np.empty((2, len(ascending)))
    count = np.empty(len(ascending), np.int64)
    # From the top down: at a lower threshold much stays as it was (core/merge.py).
    ends = range(len(ascending), 0, -THRESHOLDS_PER_CHUNK)
    chunks = iter([range(max(end - THRESHOLDS_PER_CHUNK, 0), end) for end in ends])

    def work(*_: int) -> None:
        with single_threaded():  # the other threads do the same
            merger: ThresholdMerge | None = None
            for chunk in chunks:
                merger = merger or ThresholdMerge(window)
                for row in reversed(chunk):
                    at = replace(config, threshold=float(ascending[row]))
                    aicc[row], bias[row], count[row] = merger.merge(at)

    for_parts([(k, k + 1) for k in range(helpers() + 1)], work)
    vertices = np.flatnonzero(window.change.member)
    own = np.zeros(len(window.change.member))  # AICc of every vertex as a segment of its own
    segments_aicc(window.graph.moments, vertices, config.model.noise_variance, own)
    singletons = float(np.sum(own[vertices]))
    return Curve(config.criterion, len(vertices), singletons, ascending, aicc, bias, count)


class ThresholdMerge:
    """Merges one window at one threshold after another; fast where each is below the last."""

    def __init__(self, window: WindowGraph) -> None:
        self._graph = window.graph.with_own_unions()
        self._change = window.change
        self._merge = Merge()

    def merge(self, config: Config) -> tuple[float, float, int]:
        """AICc, its bias term, and the number of segments with these settings."""
        merged = self._merge.update(self._graph, self._change, rule_of(config))
        self._change = self._change.without_changes()
        sizes, times = np.unique(self._graph.moments["count"][merged.roots], return_counts=True)
        biases = np.array([aicc_bias(size) for size in sizes])
        return float(np.sum(merged.aicc)), float(np.sum(times * biases)), len(merged.roots)
