"""The pipeline: sweeps in, the segmented window out."""

from dataclasses import replace

import numpy as np

from ellipseg_ros.config import Config
from ellipseg_ros.core import edges, ellipsoids, merge, neighbours, window
from ellipseg_ros.core.tracking import Tracker
from ellipseg_ros.core.window import TAKES_PART, Window
from ellipseg_ros.data import ISOLATED, Array, Ellipsoids, Segmentation, Sweep
from ellipseg_ros.grouping import SECOND, why_restart


def segment(
    points: Array, config: Config | None = None, origin: Array | None = None
) -> Segmentation:
    """Segment one cloud; points (n, 3), m. NaN and Inf are rejected, not refused.

    origin: (3,) m, subtracted first; None: whole kilometres near the cloud. With the origin of a
    window's segmentation, that one is repeated bit for bit.
    """
    config = replace(config or Config(), max_points_per_second=0)
    return Segmenter(config, origin).process(Sweep(stamp_ns=0, points=points))


class Segmenter:
    """Segments a sliding window of sweeps; every call of `process` is one update."""

    def __init__(self, config: Config | None = None, origin: Array | None = None) -> None:
        self._config = config or Config()
        self._given_origin = None if origin is None else np.asarray(origin, dtype=np.float64)
        self._tracker = Tracker()
        self._window: Window | None = None
        self._sequence = 0
        self._restart = ""

    @property
    def config(self) -> Config:
        """The settings in force."""
        return self._config

    def configure(self, config: Config) -> None:
        """Take new settings, from the next update on; the window and the ids stay."""
        self._config = config

    def reset(self, reason: str = "asked for") -> None:
        """Forget the window; ids go on. The next update carries `reason` and removes all ids."""
        self._window = None
        self._tracker.reset()
        self._restart = reason

    def process(self, sweep: Sweep) -> Segmentation:
        """Segment the window that ends with `sweep`."""
        restart = sweep.restart or self._why_restart(sweep)
        if restart:
            self.reset(restart)
        self._window = window.push(self._window, sweep, self._config, self._given_origin)
        points = self._window.local
        graph = neighbours.find_neighbours(points, self._config.graph)
        nodes = np.empty((2 * len(points), ellipsoids.WIDTH))
        ellipsoids.initial_ellipsoids(points, graph.rows, nodes)
        masses = np.empty(2 * len(points))
        masses[: len(points)] = ellipsoids.neighbour_masses(points, graph.rows)
        walk = edges.find_edges(graph.rows, nodes)
        merged = merge.merge(nodes, walk, graph.isolated, masses, self._config)
        return self._result(points, nodes, merged)

    def _why_restart(self, sweep: Sweep) -> str:
        if self._window is None or not len(sweep):
            return ""
        newest = replace(sweep, stamp_ns=int(sweep.times_ns.max()))
        lateness = round(self._config.max_lateness * SECOND)
        return why_restart(self._window, newest, self._window.end_ns, lateness)

    def _result(self, points: Array, nodes: Array, merged: merge.Merged) -> Segmentation:
        now = self._window
        assert now is not None  # process has just set it
        origin = np.zeros(3) if now.origin is None else now.origin
        labels = now.fate.astype(np.int32)
        labels[now.fate == TAKES_PART] = np.where(merged.labels < 0, ISOLATED, merged.labels)
        own = ellipsoids.segment_moments(points, merged.labels, len(merged.roots))
        own_ellipsoids = _ellipsoids(own, nodes[merged.roots], merged.aicc, origin)
        facts = np.column_stack([own[:, : ellipsoids.EIGENVALUES], merged.aicc])
        tracks = self._tracker.assign(now.arrival, labels, facts)
        first, last = _seen(labels, now.times_ns, len(merged.roots))
        found = Segmentation(
            labels=labels,
            ellipsoids=own_ellipsoids,
            aicc=float(np.sum(merged.aicc)),
            criterion=self._config.criterion,
            threshold=self._config.tau,
            origin=origin,
            points=now.points,
            arrival=now.arrival,
            times_ns=now.times_ns,
            fields=now.fields,
            frame_id=now.frame_id,
            ids=tracks.ids,
            state=tracks.state,
            parents=tracks.parents,
            removed=tracks.removed,
            first_seen_ns=first,
            last_seen_ns=last,
            start_ns=now.start_ns,
            end_ns=now.end_ns,
            sequence=self._sequence,
            restart=self._restart,
        )
        self._sequence += 1
        self._restart = ""
        return found


def _seen(labels: Array, times: Array, segments: int) -> tuple[Array, Array]:
    """Times of the oldest and of the newest point of every segment, ns."""
    first = np.full(segments, np.iinfo(np.int64).max)
    last = np.full(segments, np.iinfo(np.int64).min)
    inside = labels >= 0
    np.minimum.at(first, labels[inside], times[inside])
    np.maximum.at(last, labels[inside], times[inside])
    return first, last


def _ellipsoids(own: Array, model: Array, aicc: Array, origin: Array) -> Ellipsoids:
    """Nodes as a record in the world frame; own: moments of the points, model: of the unions."""
    axes = own[:, ellipsoids.AXES : ellipsoids.AXES + 9].reshape(-1, 3, 3).transpose(0, 2, 1)
    planarity = own[:, ellipsoids.PLANARITY].copy()
    cylindricality = own[:, ellipsoids.CYLINDRICALITY].copy()
    return Ellipsoids(
        count=own[:, ellipsoids.COUNT].astype(np.int64),
        mean=_mean(own) + origin,
        covariance=_covariance(own),
        eigenvalues=own[:, ellipsoids.EIGENVALUES : ellipsoids.EIGENVALUES + 3].copy(),
        axes=np.ascontiguousarray(axes),
        planarity=planarity,
        cylindricality=cylindricality,
        sphericity=np.maximum(0.0, 1.0 - planarity - cylindricality),
        aicc=aicc,
        model_mean=_mean(model) + origin,
        model_covariance=_covariance(model),
    )


def _mean(nodes: Array) -> Array:
    return nodes[:, ellipsoids.MEAN : ellipsoids.MEAN + 3]


def _covariance(nodes: Array) -> Array:
    """(s, 3, 3) from xx, xy, xz, yy, yz, zz."""
    six = nodes[:, ellipsoids.COVARIANCE : ellipsoids.COVARIANCE + 6]
    return six[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3)
