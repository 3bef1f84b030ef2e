"""An hour of driving: does anything grow, slow down, or drift away from batch?"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from threading import Timer
from typing import Any

import numpy as np

from ellipseg_ros.cli.node_process import START_TIMEOUT_S
from ellipseg_ros.config import Config
from ellipseg_ros.io.bag import node_types
from ellipseg_ros.io.limits import nanoseconds
from ellipseg_ros.io.pointcloud2 import read_fields
from ellipseg_ros.io.topics import BAG_TOPICS
from ellipseg_ros.node.grouping import Grouping, updates
from ellipseg_ros.node.memory import state_bytes
from ellipseg_ros.records import SECOND, Array, Segmentation, Sweep, join_sweeps
from ellipseg_ros.ros.recorder import Recorder
from ellipseg_ros.segmenter import Segmenter
from studies.endurance.endless_drive import Tape
from studies.endurance.listener_process import Listening
from studies.endurance.lossless import lossless
from studies.endurance.promises import Promise, Trial

GROWTH = 0.05  # of memory, at most
SLOWER = 1.2  # times the processing time, at most
HANGS = 5.0  # s: DDS then keeps its most for a subscriber, and has not given it up


@dataclass(frozen=True)
class Length:
    """How far is driven. Laps are alike, so one may be compared with another."""

    lap_s: float
    laps: int
    early: int  # the lap that the last one is compared with, from 1
    window_s: float
    rate: float  # points/s
    state_rate: float  # points/s of the drive without ROS, which is for the size of the state

    def lap(self, since_ns: int) -> int:
        """The lap so many ns after the start, from 1."""
        return 1 + since_ns // round(self.lap_s * SECOND)


FULL = Length(60.0, 60, 10, Config().window_duration, 2500.0, 500.0)
QUICK = Length(6.0, 15, 5, 3.0, 0.0, 1000.0)


class Latest:
    """The last message of every topic, and what the node held whenever an update came."""

    def __init__(self) -> None:
        self.messages: dict[str, bytes] = {}
        self.held: list[tuple[int, float]] = []  # ns, of the update; MB
        self.memory_mb: Callable[[], float] = lambda: 0.0

    def write(self, topic: str, time_ns: int, message: bytes) -> None:
        """Keep it instead of the one before."""
        self.messages[topic] = message
        if topic == "/segments":
            self.held.append((time_ns, self.memory_mb()))

    def write_points(self, sweep: Sweep) -> None:
        """Nothing: what was sent is known."""

    def decoded(self, topic: str) -> Any:
        """The last message of a topic."""
        return node_types().deserialize_cdr(self.messages[topic], BAG_TOPICS[topic].type)


@dataclass
class Drive:
    """What was sent, and what came of it."""

    latest: Latest = field(default_factory=Latest)
    recent: deque[Sweep] = field(default_factory=deque)  # of twice the window
    clouds: int = 0
    points: int = 0
    updates: int = 0  # that the node must make
    processing_ms: dict[int, float] = field(default_factory=dict)  # by lap
    said: dict[str, str] = field(default_factory=dict)  # its last diagnostics


def hour(trial: Trial) -> list[Promise]:
    """The node on an endless drive; and the state of a segmenter on another one."""
    length = QUICK if trial.quick else FULL
    tape = Tape(length.lap_s, length.laps, length.rate, seed=trial.seed)
    drive = _through_the_node(tape, length, trial)
    sizes = _state_sizes(length, trial)
    return [
        _memory(drive, tape, length),
        _state(sizes, length),
        _speed(drive, length),
        _equal_to_batch(drive, tape, length),
        _nothing_lost(drive),
    ]


# --- driving ---------------------------------------------------------------------------------


def _through_the_node(tape: Tape, length: Length, trial: Trial) -> Drive:
    """As fast as the node can, every topic subscribed, nothing lost."""
    drive = Drive()
    settings = {"window_duration": length.window_s}
    with (
        lossless(tape, _config(length), drive.latest, settings) as through,
        Listening(through.ros_args) as other,
    ):
        drive.latest.memory_mb = through.node.memory_mb
        other.wait_for_topics(START_TIMEOUT_S)
        through.replayer.run(_watch(drive, through.recorder, other, length, trial))
        drive.said = through.finish(drive.updates)
    return drive


def _config(length: Length) -> Config:
    return Config(window_duration=length.window_s)


def _watch(
    drive: Drive, recorder: Recorder, other: Listening, length: Length, trial: Trial
) -> Callable[[Sweep], None]:
    """What is called with every cloud that was sent.

    Another subscriber hangs for a while after the first lap. So all that DDS ever keeps for slow
    ones is there before memory is measured, and later growth would be a leak.
    """
    grouping = Grouping(_config(length))
    first: list[int] = []
    hangs: list[Timer] = []  # that lets it read on; not an update, which it may hold up

    def sent(sweep: Sweep) -> None:
        drive.clouds += 1
        drive.points += len(sweep)
        drive.updates += len(grouping.push(sweep))
        drive.recent.append(sweep)
        while drive.recent[0].stamp_ns < sweep.stamp_ns - 2 * round(length.window_s * SECOND):
            drive.recent.popleft()
        first[:] = first or [sweep.stamp_ns]
        lap = length.lap(sweep.stamp_ns - first[0])
        if lap == 2 and not hangs:
            hangs.append(Timer(HANGS, other.read_on))
            other.stop_reading()
            hangs[0].start()
        if lap not in drive.processing_ms:
            trial.say(f"hour: lap {lap} of {length.laps}")
        said = recorder.diagnostics.get("processing median [s]", "nan")
        drive.processing_ms[lap] = 1e3 * float(said)

    return sent


def _state_sizes(length: Length, trial: Trial) -> dict[int, int]:
    """Bytes of all that a segmenter holds, by lap: the most at any update."""
    trial.say("hour: the same without ROS, with few points")
    tape = Tape(length.lap_s, length.laps, length.state_rate, seed=trial.seed)
    config = _config(length)
    segmenter = Segmenter(config)
    sizes: dict[int, int] = {}
    start = None
    for group in updates(tape, config):
        start = group.stamp_ns if start is None else start
        segmenter.process(group)
        lap = length.lap(group.stamp_ns - start)
        sizes[lap] = max(sizes.get(lap, 0), state_bytes(segmenter))
    return sizes


# --- promises --------------------------------------------------------------------------------


def _memory(drive: Drive, tape: Tape, length: Length) -> Promise:
    start = next(iter(tape)).stamp_ns
    early, late = (
        np.mean([mb for ns, mb in drive.latest.held if length.lap(ns - start) == lap])
        for lap in (length.early, length.laps)
    )
    growth = late / early - 1.0
    return Promise(
        "the node's memory does not grow",
        f"{length.laps * length.lap_s / 60.0:g} min of driving in ever new places, "
        f"{drive.points:,} points, {drive.updates:,} updates, all topics subscribed twice, "
        f"one subscriber hangs for {HANGS:g} s in lap 2, so that DDS keeps all that it ever "
        f"will; resident memory, mean over a lap of {length.lap_s:g} s",
        f"lap {length.early}: {early:.0f} MB, lap {length.laps}: {late:.0f} MB ({growth:+.1%}; "
        f"at most {GROWTH:+.0%})",
        bool(np.isfinite(growth)),
        bool(growth <= GROWTH),
    )


def _state(sizes: dict[int, int], length: Length) -> Promise:
    early, late = (sizes[lap] / 1e6 for lap in (length.early, length.laps))
    growth = late / early - 1.0
    return Promise(
        "graph, dendrogram, ids and all other tables of the segmenter do not grow",
        f"the same drive with {length.state_rate:,.0f} points/s, without ROS; bytes of all "
        "arrays and lists that a Segmenter holds, the most in a lap",
        f"lap {length.early}: {early:.1f} MB, lap {length.laps}: {late:.1f} MB ({growth:+.1%}; "
        f"at most {GROWTH:+.0%})",
        growth <= GROWTH,
    )


def _speed(drive: Drive, length: Length) -> Promise:
    early, late = (drive.processing_ms[lap] for lap in (length.early, length.laps))
    return Promise(
        "updates do not get slower",
        "the node's own median of its last 100 updates",
        f"lap {length.early}: {early:.0f} ms, lap {length.laps}: {late:.0f} ms "
        f"(at most {SLOWER:g} times)",
        bool(np.isfinite([early, late]).all()),
        late <= SLOWER * early,
    )


def _equal_to_batch(drive: Drive, tape: Tape, length: Length) -> Promise:
    said, cloud = (drive.latest.decoded(topic) for topic in ("/segments", "/segmented_points"))
    end_ns = nanoseconds(said.window_end)
    recent = [s for s in drive.recent if int(s.times_ns.max(initial=s.stamp_ns)) <= end_ns]
    config = _config(length)
    origin = Segmenter(config).process(next(iter(tape))).origin
    batch = Segmenter(config, origin).process(join_sweeps(recent))
    same = equal_segments(batch, said, read_fields(cloud))
    return Promise(
        "the last update is that of batch, bit for bit",
        "the points of the last window segmented at once; labels of all points, moments and AICc "
        "of all segments compared",
        f"{len(batch.points):,} points, {len(batch.ids):,} segments: "
        + ("equal" if same else "**different**"),
        same,
    )


def equal_segments(batch: Segmentation, said: Any, fields: Array) -> bool:
    """Whether a node says the same but for ids: `said`, a SegmentArray; `fields` of its cloud."""
    labels = fields["label"]
    if any(not np.array_equal(fields[name], batch.points[:, k]) for k, name in enumerate("xyz")):
        return False
    row, first = np.unique(batch.labels, return_index=True)
    ids = labels[first[row >= 0]]  # of the rows of the batch
    by_id = {segment.id: segment for segment in said.segments}
    if not np.array_equal(labels, np.append(ids, 0)[np.maximum(batch.labels, -1)]):
        return False
    if set(ids.tolist()) != by_id.keys() or len(ids) != len(by_id):
        return False
    told = [by_id[number] for number in ids.tolist()]
    ours = batch.ellipsoids
    return bool(
        said.aicc == batch.aicc
        and np.array_equal([one.count for one in told], ours.count)
        and np.array_equal([[one.mean.x, one.mean.y, one.mean.z] for one in told], ours.mean)
        and np.array_equal([one.covariance for one in told], ours.covariance.reshape(-1, 9))
        and np.array_equal([one.aicc for one in told], ours.aicc)
    )


def _nothing_lost(drive: Drive) -> Promise:
    said = {
        key: int(drive.said[key])
        for key in ("clouds received", "clouds rejected", "clouds lost by DDS", "restarts")
    }
    came = len(drive.latest.held)
    return Promise(
        "every cloud is taken, every update is published",
        f"{drive.clouds:,} clouds sent on a reliable topic; the replayer waits for the node",
        f"{said['clouds received']:,} clouds received, {said['clouds lost by DDS']} lost, "
        f"{said['clouds rejected']} rejected; {came:,} of {drive.updates:,} updates, "
        f"{said['restarts']} restarts",
        list(said.values()) == [drive.clouds, 0, 0, 0] and came == drive.updates,
    )
