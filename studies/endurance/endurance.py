"""Subject `endurance`: an hour of driving without growth, slowdown or deviation from batch."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from threading import Timer
from typing import Any

import numpy as np

from ellipseg_ros.cli.node_process import START_TIMEOUT_S
from ellipseg_ros.config import Config
from ellipseg_ros.core.fields import join_sweeps
from ellipseg_ros.io.bag import node_types
from ellipseg_ros.io.limits import nanoseconds
from ellipseg_ros.io.pointcloud2 import read_fields
from ellipseg_ros.io.topics import BAG_TOPICS
from ellipseg_ros.node.grouping import Grouping, updates
from ellipseg_ros.node.memory import resident_mb
from ellipseg_ros.poses.placer import Event
from ellipseg_ros.records import SECOND, Array, Segmentation, Sweep
from ellipseg_ros.ros.recorder import Recorder
from ellipseg_ros.segmenter import Segmenter
from studies.endurance.endless_drive import EndlessDrive
from studies.endurance.requirements import Options, Requirement
from studies.endurance.running import lossless, newest_time
from studies.endurance.subscriber_process import SubscriberProcess
from studies.memory import state_bytes

MAX_GROWTH = 0.05  # of memory
MAX_SLOWDOWN = 1.2  # ratio of processing times
PAUSE_S = 5.0  # of a subscriber: DDS then holds as much for it as it ever will


@dataclass(frozen=True)
class Length:
    """Length of the drive in laps, which are alike so that two of them can be compared."""

    lap_s: float
    laps: int
    reference_lap: int  # that the last lap is compared with; laps count from 1
    window_s: float
    rate: float  # points/s; 0: those of the simulated scanner
    state_rate: float  # points/s of the drive without ROS that measures the segmenter's state

    def lap(self, elapsed_ns: int) -> int:
        """Number of the lap at a time after the start."""
        return 1 + elapsed_ns // round(self.lap_s * SECOND)


FULL = Length(60.0, 60, 10, Config().window_duration, 2500.0, 500.0)
QUICK = Length(6.0, 15, 5, 3.0, 0.0, 1000.0)


class LatestMessages:
    """The last message of every topic, and the node's memory at every update; a Sink."""

    def __init__(self) -> None:
        self.messages: dict[str, bytes] = {}
        self.memory: list[tuple[int, float]] = []  # time of the update, ns; MB
        self.memory_mb: Callable[[], float] = lambda: 0.0  # of the node

    def write(self, topic: str, time_ns: int, message: bytes) -> None:
        """Keep a message instead of the one before."""
        self.messages[topic] = message
        if topic == "/segments":
            self.memory.append((time_ns, self.memory_mb()))

    def write_event(self, event: Event) -> None:
        """Ignore a sent cloud."""

    def decoded(self, topic: str) -> Any:
        """The last message of a topic."""
        return node_types().deserialize_cdr(self.messages[topic], BAG_TOPICS[topic].type)


@dataclass
class Drive:
    """What was sent, and what the node published and reported."""

    latest: LatestMessages = field(default_factory=LatestMessages)
    recent: deque[Sweep] = field(default_factory=deque)  # of two windows
    clouds: int = 0
    points: int = 0
    updates: int = 0  # that the node must publish
    processing_ms: dict[int, float] = field(default_factory=dict)  # by lap
    report: dict[str, str] = field(default_factory=dict)  # the last diagnostics


def endurance(options: Options) -> list[Requirement]:
    """Replay an endless drive to the node, and process another one without ROS."""
    length = QUICK if options.quick else FULL
    source = EndlessDrive(length.lap_s, length.laps, length.rate, seed=options.seed)
    drive = _replayed(source, length, options)
    start_ns = next(iter(source)).stamp_ns
    laps = [
        [mb for time_ns, mb in drive.latest.memory if length.lap(time_ns - start_ns) == lap]
        for lap in (length.reference_lap, length.laps)
    ]
    sizes = _state_sizes(length, options)
    return [
        _memory(drive, [float(np.mean(lap)) for lap in laps], length),
        _state([sizes[lap] / 1e6 for lap in (length.reference_lap, length.laps)], length),
        _speed([drive.processing_ms[lap] for lap in (length.reference_lap, length.laps)], length),
        _equal_to_batch(drive, source, length),
        _nothing_lost(drive),
    ]


# --- driving ---------------------------------------------------------------------------------


def _replayed(source: EndlessDrive, length: Length, options: Options) -> Drive:
    """Replay losslessly, as fast as the node processes, with all topics subscribed twice."""
    drive = Drive()
    settings = {"window_duration": length.window_s}
    with (
        lossless(source, _config(length), drive.latest, settings) as session,
        SubscriberProcess(session.ros_args) as subscriber,
    ):
        drive.latest.memory_mb = partial(resident_mb, session.node.pid)
        subscriber.wait_for_topics(START_TIMEOUT_S)
        note = _note(drive, session.recorder, subscriber, length, options)
        session.replayer.run(note)
        drive.report = session.finish(drive.updates)
    return drive


def _config(length: Length) -> Config:
    return Config(window_duration=length.window_s)


def _note(
    drive: Drive,
    recorder: Recorder,
    subscriber: SubscriberProcess,
    length: Length,
    options: Options,
) -> Callable[[Sweep], None]:
    """A callback for every cloud that was sent.

    The subscriber is paused for a while after the first lap. So DDS holds as much as it ever does
    for slow subscribers before memory is measured, and later growth would be a leak.
    """
    grouping = Grouping(_config(length))
    start_ns: list[int] = []
    timers: list[Timer] = []  # a timer, not an update, resumes: the pause may delay updates

    def note(sweep: Sweep) -> None:
        drive.clouds += 1
        drive.points += len(sweep)
        drive.updates += len(grouping.push(sweep))
        drive.recent.append(sweep)
        while drive.recent[0].stamp_ns < sweep.stamp_ns - 2 * round(length.window_s * SECOND):
            drive.recent.popleft()
        start_ns[:] = start_ns or [sweep.stamp_ns]
        lap = length.lap(sweep.stamp_ns - start_ns[0])
        if lap == 2 and not timers:
            timers.append(Timer(PAUSE_S, subscriber.resume))
            subscriber.pause()
            timers[0].start()
        if lap not in drive.processing_ms:
            options.log(f"endurance: lap {lap} of {length.laps}")
        median = recorder.diagnostics.get("processing median [s]", "nan")
        drive.processing_ms[lap] = 1e3 * float(median)

    return note


def _state_sizes(length: Length, options: Options) -> dict[int, int]:
    """Largest size of all that a segmenter holds, bytes, by lap."""
    options.log("endurance: the same without ROS, with few points")
    source = EndlessDrive(length.lap_s, length.laps, length.state_rate, seed=options.seed)
    config = _config(length)
    segmenter = Segmenter(config)
    sizes: dict[int, int] = {}
    start_ns = None
    for group in updates(source, config):
        start_ns = group.stamp_ns if start_ns is None else start_ns
        segmenter.process(group)
        lap = length.lap(group.stamp_ns - start_ns)
        sizes[lap] = max(sizes.get(lap, 0), state_bytes(segmenter))
    return sizes


# --- requirements ----------------------------------------------------------------------------


def _compared(values: list[float], length: Length, unit: str, digits: int) -> str:
    texts = [f"{value:.{digits}f} {unit}" for value in values]
    return f"lap {length.reference_lap}: {texts[0]}, lap {length.laps}: {texts[1]}"


def _growth(values: list[float], length: Length, digits: int) -> tuple[float, str]:
    growth = values[1] / values[0] - 1.0
    text = _compared(values, length, "MB", digits)
    return growth, f"{text} ({growth:+.1%}; at most {MAX_GROWTH:+.0%})"


def _memory(drive: Drive, memory_mb: list[float], length: Length) -> Requirement:
    growth, text = _growth(memory_mb, length, 0)
    return Requirement(
        "the node's memory does not grow",
        f"{length.laps * length.lap_s / 60.0:g} min of driving in ever new places, "
        f"{drive.points:,} points, {drive.updates:,} updates, all topics subscribed twice, one "
        f"subscriber paused for {PAUSE_S:g} s in lap 2, to fill the queues of DDS; resident "
        f"memory, mean over a lap of {length.lap_s:g} s",
        text,
        bool(np.isfinite(growth)),
        bool(growth <= MAX_GROWTH),
    )


def _state(sizes_mb: list[float], length: Length) -> Requirement:
    growth, text = _growth(sizes_mb, length, 1)
    return Requirement(
        "graph, dendrogram, ids and all other state of the segmenter do not grow",
        f"the same drive with {length.state_rate:,.0f} points/s, without ROS; bytes of all "
        "arrays and containers of a Segmenter, maximum over a lap",
        text,
        growth <= MAX_GROWTH,
    )


def _speed(processing_ms: list[float], length: Length) -> Requirement:
    return Requirement(
        "updates do not become slower",
        "the node's own median over its last 100 updates",
        f"{_compared(processing_ms, length, 'ms', 0)} (at most {MAX_SLOWDOWN:g} times)",
        bool(np.isfinite(processing_ms).all()),
        processing_ms[1] <= MAX_SLOWDOWN * processing_ms[0],
    )


def _equal_to_batch(drive: Drive, source: EndlessDrive, length: Length) -> Requirement:
    message, cloud = (drive.latest.decoded(topic) for topic in ("/segments", "/segmented_points"))
    end_ns = nanoseconds(message.window_end)
    window = [sweep for sweep in drive.recent if newest_time(sweep) <= end_ns]
    config = _config(length)
    origin = Segmenter(config).process(next(iter(source))).origin
    batch = Segmenter(config, origin).process(join_sweeps(window))
    equal = equal_segments(batch, message, read_fields(cloud))
    return Requirement(
        "the last update equals batch segmentation, bit for bit",
        "the points of the last window segmented in one call; labels of all points, moments and "
        "AICc of all segments compared",
        f"{len(batch.points):,} points, {len(batch.ids):,} segments: "
        + ("equal" if equal else "**different**"),
        equal,
    )


def equal_segments(batch: Segmentation, message: Any, fields: Array) -> bool:
    """Whether a published update equals a segmentation except for ids.

    message: SegmentArray. fields: of `segmented_points`.
    """
    labels = fields["label"]
    if any(not np.array_equal(fields[name], batch.points[:, k]) for k, name in enumerate("xyz")):
        return False
    row, first = np.unique(batch.labels, return_index=True)
    ids = labels[first[row >= 0]]  # of the rows of the batch
    by_id = {segment.id: segment for segment in message.segments}
    if not np.array_equal(labels, np.append(ids, 0)[np.maximum(batch.labels, -1)]):
        return False
    if set(ids.tolist()) != by_id.keys() or len(ids) != len(by_id):
        return False
    segments = [by_id[number] for number in ids.tolist()]
    expected = batch.ellipsoids
    return bool(
        message.aicc == batch.aicc
        and np.array_equal([s.count for s in segments], expected.count)
        and np.array_equal([[s.mean.x, s.mean.y, s.mean.z] for s in segments], expected.mean)
        and np.array_equal([s.covariance for s in segments], expected.covariance.reshape(-1, 9))
        and np.array_equal([s.aicc for s in segments], expected.aicc)
    )


def _nothing_lost(drive: Drive) -> Requirement:
    names = ("clouds received", "clouds rejected", "clouds lost by DDS", "restarts")
    counts = {name: int(drive.report[name]) for name in names}
    received = len(drive.latest.memory)
    return Requirement(
        "every cloud is processed and every update published",
        f"{drive.clouds:,} clouds sent reliably by a replayer that waits for the node",
        f"{counts['clouds received']:,} clouds received, {counts['clouds lost by DDS']} lost, "
        f"{counts['clouds rejected']} rejected; {received:,} of {drive.updates:,} updates, "
        f"{counts['restarts']} restarts",
        list(counts.values()) == [drive.clouds, 0, 0, 0] and received == drive.updates,
    )
