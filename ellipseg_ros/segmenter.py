"""The pipeline: sweeps in, the segmented window out."""

from dataclasses import replace

import numpy as np

from ellipseg_ros.config import Config
from ellipseg_ros.core.adjacency import segment_adjacency
from ellipseg_ros.core.criteria import CRITERIA, aicc_bias, rule_of
from ellipseg_ros.core.graph import Graph
from ellipseg_ros.core.merge import SLAB_MIN_VERTICES, Merge
from ellipseg_ros.core.restart import RestartRule
from ellipseg_ros.core.segments import Segments, SegmentStage
from ellipseg_ros.core.window import Arrivals, Window
from ellipseg_ros.landmarks.stage import LandmarkStage
from ellipseg_ros.objects.stage import ObjectStage
from ellipseg_ros.records import SECOND, Array, Segmentation, Sweep
from ellipseg_ros.result import Cause, segmentation_record


def segment(
    points: Array, config: Config | None = None, origin: Array | None = None
) -> Segmentation:
    """Segment one cloud; points (n, 3), m. NaN and Inf are rejected, not refused.

    origin: (3,) m, subtracted first; None: whole kilometres near the cloud. With the origin of a
    window's segmentation, that segmentation is repeated bit for bit.
    """
    config = replace(config or Config(), max_points_per_second=0, max_points=0, resolution=0)
    return Segmenter(config, origin).process(Sweep(stamp_ns=0, points=points))


class Segmenter:
    """Segments a sliding window of sweeps; every call of `process` is one update.

    After every update the result is that of `segment` for the points in the window, bit for bit,
    but only what changed has been computed.
    """

    def __init__(self, config: Config | None = None, origin: Array | None = None) -> None:
        self._config = config or Config()
        self._given_origin = None if origin is None else np.array(origin, dtype=np.float64)
        self._restart_rule = RestartRule()
        self._window = Window(self._given_origin)
        self._graph = Graph(self._config.graph)
        self._merge = Merge()
        self._segments = SegmentStage()
        self._objects = ObjectStage()
        self._landmarks = LandmarkStage()
        self._sequence = 0
        self._cause = Cause()  # what the next result has to name

    @property
    def config(self) -> Config:
        """The settings in force."""
        return self._config

    def configure(self, config: Config, reason: str = "set") -> None:
        """Apply new settings from the next update on; window and ids are kept.

        reason: for `threshold_change` of that update, if criterion or threshold change.
        """
        old, self._config = self._config, config
        if (config.criterion, config.tau) != (old.criterion, old.tau):
            self._cause = replace(self._cause, threshold_change=reason)
        if (config.resolution, config.resolution_range) != (old.resolution, old.resolution_range):
            self.reset("the resolution changed")
        elif config.graph != old.graph:
            self._clear_graph()

    def reset(self, reason: str = "requested") -> None:
        """Forget the window; ids go on. The next update carries `reason` and removes all ids."""
        self._restart_rule.reset()
        self._clear_window(reason)

    def process(self, sweep: Sweep) -> Segmentation:
        """Segment the window that ends with `sweep`."""
        arrivals = self._push(sweep)
        change = self._graph.update(arrivals)
        merged = self._merge.update(self._graph, change, rule_of(self._config))
        segments = self._segments.update(self._window, self._graph, merged)
        return self._result(arrivals, segments)

    def _push(self, sweep: Sweep) -> Arrivals:
        """Advance the window, empty if the sweep restarts it; a new graph gets all its points."""
        restart = self._restart_rule.take(sweep, round(self._config.max_lateness * SECOND))
        if restart:
            self._clear_window(restart)
        arrivals = self._window.push(sweep, self._config)
        return arrivals if self._graph.count else self._window.as_arrivals(arrivals)

    def _result(self, arrivals: Arrivals, segments: Segments) -> Segmentation:
        """Group the segments, choose landmarks, and put the record together."""
        config, window, graph = self._config, self._window, self._graph
        adjacency = None
        if config.objects.enabled or config.landmarks.enabled:
            labels, count = segments.vertex_labels, len(segments.moments)
            adjacency = segment_adjacency(graph.knn_indices, labels, count)
        objects = self._objects.update(window, graph, segments, adjacency, config.objects)
        landmarks = self._landmarks.update(window, segments, adjacency, config.landmarks)
        cause, self._cause = replace(self._cause, sequence=self._sequence), Cause()
        self._sequence += 1
        return segmentation_record(
            config, window, arrivals, segments, adjacency, objects, landmarks, cause
        )

    def _clear_window(self, reason: str) -> None:
        self._cause = replace(self._cause, restart=reason)
        self._window = Window(self._given_origin)
        for stage in (self._segments, self._objects, self._landmarks):
            stage.reset()
        self._clear_graph()

    def _clear_graph(self) -> None:
        self._graph, self._merge = Graph(self._config.graph), Merge()
        self._segments.clear_cache()


def warm_up() -> None:
    """Compile every kernel, or load it from the cache, on a few points.

    Later, no update waits for the compiler, whatever the settings are.
    """
    rng = np.random.default_rng(0)
    segment(rng.uniform(0.0, 20.0, (2 * SLAB_MIN_VERTICES, 3)))
    aicc_bias(1.0)  # a kernel within others, which the tuning calls by itself
    for criterion in CRITERIA:
        segmenter = Segmenter(Config(criterion=criterion, window_duration=3.0))
        for second in range(8):
            points = rng.uniform(0.0, 2.0, (200, 3)) + [0.5 * second, 0.0, 0.0]
            points[40:, 1] *= 0.01  # a wall, for the landmarks
            segmenter.process(Sweep(stamp_ns=second * SECOND, points=points))
        segmenter.configure(Config(criterion=criterion, threshold=0.0))
        segmenter.process(Sweep(stamp_ns=8 * SECOND, points=np.zeros((0, 3))))
