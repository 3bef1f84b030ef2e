"""The pipeline: sweeps in, the segmented window out."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ellipseg_ros.config import CRITERIA, Config
from ellipseg_ros.core.adjacency import segment_adjacency
from ellipseg_ros.core.criteria import bias
from ellipseg_ros.core.edge_sorting import Edges, no_edges
from ellipseg_ros.core.edges import Renewed, renumbered, update_edges
from ellipseg_ros.core.ellipsoids import (
    COVARIANCE,
    MEAN,
    WIDTH,
    initial_ellipsoids,
    neighbour_masses,
    segment_moments,
    segment_times,
)
from ellipseg_ros.core.merge import SLABBED, Merge, Merged
from ellipseg_ros.core.neighbours import Change, Neighbours
from ellipseg_ros.core.tracking import Tracker
from ellipseg_ros.core.window import TAKES_PART, Window
from ellipseg_ros.landmarks.finder import find_landmarks
from ellipseg_ros.landmarks.tracking import LandmarkTracker
from ellipseg_ros.node.grouping import Before, and_then, why_restart
from ellipseg_ros.objects.finder import find_objects
from ellipseg_ros.records import (
    SECOND,
    Array,
    Landmarks,
    Objects,
    SegmentAdjacency,
    Segmentation,
    Sweep,
)
from ellipseg_ros.result import ellipsoid_records, landmark_records, object_records

SPARE = 1.5  # rows made per row needed, so that rows are renumbered seldom
DEAD = 0.25  # share of dead rows at which they are
VAST = 5  # rows per row needed, beyond the first LARGE ones, from which on they are given back
LARGE = 5_000


def segment(
    points: Array, config: Config | None = None, origin: Array | None = None
) -> Segmentation:
    """Segment one cloud; points (n, 3), m. NaN and Inf are rejected, not refused.

    origin: (3,) m, subtracted first; None: whole kilometres near the cloud. With the origin of a
    window's segmentation, that one is repeated bit for bit.
    """
    config = replace(config or Config(), max_points_per_second=0, max_points=0)
    return Segmenter(config, origin).process(Sweep(stamp_ns=0, points=points))


def warm_up() -> None:
    """Compile every kernel, or load it from the cache, on a few points.

    Later, no update waits for the compiler, whatever the settings are.
    """
    rng = np.random.default_rng(0)
    segment(rng.uniform(0.0, 20.0, (2 * SLABBED, 3)))
    bias(1.0)  # a kernel within others, which the tuning calls by itself
    for criterion in CRITERIA:
        segmenter = Segmenter(Config(criterion=criterion, window_duration=3.0))
        for second in range(8):
            points = rng.uniform(0.0, 2.0, (200, 3)) + [0.5 * second, 0.0, 0.0]
            points[40:, 1] *= 0.01  # a wall, for the landmarks
            segmenter.process(Sweep(stamp_ns=second * SECOND, points=points))
        segmenter.configure(Config(criterion=criterion, threshold=0.0))
        segmenter.process(Sweep(stamp_ns=8 * SECOND, points=np.zeros((0, 3))))


class Own(NamedTuple):
    """What was found of the segments' own points, for the next update; by segment."""

    moments: Array  # (s, 24)
    times: Array  # (s, 2) ns


class Segmenter:
    """Segments a sliding window of sweeps; every call of `process` is one update.

    After every update the result is that of `segment` for the points in the window, bit for bit,
    but only what changed has been computed.
    """

    _neighbours: Neighbours
    _edges: Edges
    _merge: Merge
    _own: Own
    _left_out: tuple[int, int]  # points of the last update: late, evicted

    def __init__(self, config: Config | None = None, origin: Array | None = None) -> None:
        self._config = config or Config()
        self._given_origin = None if origin is None else np.array(origin, dtype=np.float64)
        self._tracker = Tracker()
        self._object_tracker = Tracker()
        self._landmark_tracker = LandmarkTracker()
        self._sequence = 0
        self._restart = ""
        self._threshold_change = ""
        self._before: Before | None = None
        self._window = Window(self._given_origin)
        self._begin_graph()

    @property
    def config(self) -> Config:
        """The settings in force."""
        return self._config

    def configure(self, config: Config, reason: str = "set") -> None:
        """Take new settings, from the next update on; the window and the ids stay.

        reason: for `threshold_change` of that update, if criterion or threshold change.
        """
        old = self._config
        if (config.criterion, config.tau) != (old.criterion, old.tau):
            self._threshold_change = reason
        other_graph = config.graph != self._config.graph
        self._config = config
        if other_graph:
            self._begin_graph()

    def reset(self, reason: str = "asked for") -> None:
        """Forget the window; ids go on. The next update carries `reason` and removes all ids."""
        self._tracker.reset()
        self._object_tracker.reset()
        self._landmark_tracker.reset()
        self._restart = reason
        self._before = None
        self._window = Window(self._given_origin)
        self._begin_graph()

    def process(self, sweep: Sweep) -> Segmentation:
        """Segment the window that ends with `sweep`."""
        lateness = round(self._config.max_lateness * SECOND)
        before = self._before
        restart = sweep.restart or (why_restart(before, sweep, lateness) if before else "")
        if restart:
            self.reset(restart)
        self._before = and_then(self._before, sweep)
        push = self._window.push(sweep, self._config)
        self._left_out = push.late, push.evicted
        if self._neighbours.count == 0:  # a new graph of, perhaps, an old window
            push = self._window.everything()
        self._make_room(len(push.arrived))
        change = self._neighbours.update(push.arrived, push.serial, push.expired)
        remerge = self._merge.widened(change, self._config)
        self._update_ellipsoids(change, remerge)
        renewed = Renewed.after(change, self._neighbours.rows, self._merge.nodes)
        self._edges = update_edges(self._edges, renewed)
        return self._result(self._merge.update(self._edges, change, remerge))

    def _begin_graph(self) -> None:
        self._neighbours = Neighbours(self._config.graph)
        self._edges = no_edges()
        self._merge = Merge()
        self._own = Own(np.zeros((0, WIDTH)), np.zeros((0, 2), np.int64))

    def _make_room(self, arriving: int) -> None:
        """Let every stage drop its dead rows, where there are many or no room is left."""
        capacity = len(self._neighbours.status)
        living = np.flatnonzero(self._neighbours.status)
        dead = self._neighbours.count - len(living)
        needed = len(living) + arriving
        fits = self._neighbours.count + arriving <= capacity <= LARGE + VAST * needed
        if fits and dead <= DEAD * capacity:
            return
        if needed > (1.0 - DEAD / 2.0) * capacity or not capacity <= LARGE + VAST * needed:
            capacity = round(SPARE * needed) if len(living) else needed
        self._edges = renumbered(self._edges, living)
        self._merge.renumber(living, capacity)
        self._neighbours.renumber(living, capacity)

    def _update_ellipsoids(self, change: Change, remerge: Array) -> None:
        points, rows = self._neighbours.points, self._neighbours.rows
        initial_ellipsoids(points, rows, np.flatnonzero(change.dirty), self._merge.nodes)
        if self._config.criterion == "density":
            neighbour_masses(points, rows, np.flatnonzero(remerge), self._merge.masses)

    def _result(self, merged: Merged) -> Segmentation:
        now = self._window.points
        takes_part = now.fate == TAKES_PART
        labels = now.fate.astype(np.int32)
        labels[takes_part] = merged.labels[self._neighbours.status > 0]  # -1 is ISOLATED
        own = segment_moments(
            self._neighbours.points, merged.labels, merged.before, self._own.moments
        )
        times = segment_times(now.times_ns, labels, merged.before, self._own.times)
        self._own = Own(own, times)
        facts = np.column_stack([own[:, : MEAN + 3], own[:, COVARIANCE:], merged.aicc])
        tracks = self._tracker.assign(now.arrival, labels, facts, merged.before)
        adjacency = self._adjacency(merged.labels, len(own))
        objects, removed_objects = self._objects(labels, merged.labels, own, adjacency)
        model = self._merge.nodes[merged.roots]
        for column in (labels, tracks.ids):
            column.flags.writeable = False  # the next update builds on them
        found = Segmentation(
            labels=labels,
            ellipsoids=ellipsoid_records(own, model, merged.aicc, self._window.origin),
            aicc=float(np.sum(merged.aicc)),
            criterion=self._config.criterion,
            threshold=self._config.tau,
            origin=self._window.origin,
            points=now.position,
            arrival=now.arrival,
            times_ns=now.times_ns,
            fields=self._window.fields,
            frame_id=self._window.frame_id,
            ids=tracks.ids,
            state=tracks.state,
            parents=tracks.parents,
            removed=tracks.removed,
            objects=objects,
            removed_objects=removed_objects,
            adjacency=adjacency,
            landmarks=self._landmarks(labels, own, adjacency),
            first_seen_ns=times[:, 0],
            last_seen_ns=times[:, 1],
            start_ns=self._window.start_ns,
            end_ns=self._window.end_ns,
            late=self._left_out[0],
            evicted=self._left_out[1],
            sequence=self._sequence,
            restart=self._restart,
            threshold_change=self._threshold_change,
        )
        self._sequence += 1
        self._restart = self._threshold_change = ""
        return found

    def _adjacency(self, rows: Array, segments: int) -> SegmentAdjacency | None:
        """Which segments touch, for who needs it; labels of the graph's rows."""
        if not (self._config.objects.enabled or self._config.landmarks.enabled):
            return None
        return segment_adjacency(self._neighbours.rows, rows, segments)

    def _objects(
        self, labels: Array, rows: Array, own: Array, adjacency: SegmentAdjacency | None
    ) -> tuple[Objects | None, Array]:
        """Group the segments; labels of the window's points, and of the graph's rows.

        Returns the ids of objects that are no more, too.
        """
        if adjacency is None or not self._config.objects.enabled:
            return None, self._object_tracker.end()
        points, nodes = self._neighbours.points, self._merge.nodes
        level = find_objects(points, nodes, rows, own, adjacency, self._config.objects)
        object_labels = np.append(level.of_segment, np.int32(-1))[np.maximum(labels, -1)]
        facts = np.column_stack([level.nodes[:, : MEAN + 3], level.nodes[:, COVARIANCE:]])
        arrival = self._window.points.arrival
        tracks = self._object_tracker.assign(arrival, object_labels, facts)
        for column in (object_labels, tracks.ids):
            column.flags.writeable = False  # the next update builds on them
        return object_records(level, tracks, self._window.origin), tracks.removed

    def _landmarks(
        self, labels: Array, own: Array, adjacency: SegmentAdjacency | None
    ) -> Landmarks | None:
        """Choose the landmarks; labels of the window's points."""
        if adjacency is None or not self._config.landmarks.enabled:
            return None
        now, origin = self._window.points, self._window.origin
        config = self._config.landmarks
        found = find_landmarks(now.position - origin, labels, own, adjacency, config)
        followed = self._landmark_tracker.follow(now.arrival, found, self._window.end_ns)
        return landmark_records(found, followed, labels, origin)
