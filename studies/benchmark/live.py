"""Sections with ROS: publishing; latency, memory and start of the node."""

import os
import tempfile
import time
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from queue import SimpleQueue
from threading import Thread
from typing import Any

import numpy as np

from ellipseg_ros.cli.isolation import environment_variables
from ellipseg_ros.cli.node_process import START_TIMEOUT_S, NodeProcess
from ellipseg_ros.config import Config, NodeConfig
from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.io.messages import MarkerStream, write_segments
from ellipseg_ros.io.pointcloud2 import write_labelled
from ellipseg_ros.io.sources import open_source
from ellipseg_ros.node.playback import ReplayOptions
from ellipseg_ros.records import SECOND, Segmentation, State, Sweep
from ellipseg_ros.ros.replayer import Replayer
from ellipseg_ros.segmenter import Segmenter
from ellipseg_ros.simulation.simulator import FIELDS, simulate
from studies.benchmark.publishers import SegmentationPublisher
from studies.benchmark.streams import RATE, SCENE, Sizes, points_per_second, thinned
from studies.endurance.running import running
from studies.endurance.subscriber_process import SubscriberProcess
from studies.report.isolated_nodes import isolated_ros_args
from studies.report.timing import milliseconds, spread, timed

POINTS_PER_ELLIPSOID = 30  # of the published ones
PERIOD = 0.1  # s from update to update
READY = "ready; "  # in the line that the node logs
UPDATE_TIMEOUT_S = 60.0
RELIABLE = {"input_reliability": "reliable"}  # so that no cloud is lost
Section = dict[str, Any]


# --- publishing ------------------------------------------------------------------------------


def publishing(sizes: Sizes) -> Section:
    """Times of building and publishing updates in which everything or nothing has changed.

    The publishers are those of the node, in this process; the subscriber is another process.
    """
    segmentation = _many_ellipsoids(sizes.points // POINTS_PER_ELLIPSOID)
    times: dict[str, list[float]] = {}
    received: list[float] = []
    with (
        isolated_ros_args() as ros_args,
        SubscriberProcess(ros_args) as listener,
        SegmentationPublisher(ros_args) as publisher,
    ):
        listener.wait_for_topics(START_TIMEOUT_S)
        markers = MarkerStream(NodeConfig())
        for number in range(2 * sizes.runs + 1):
            state = State.UPDATED if number % 2 else State.UNCHANGED
            segmentation = _next_update(segmentation, state)
            took, ended = timed(partial(_publish, publisher, segmentation))
            arrived = listener.wait_for_update(segmentation.end_ns, UPDATE_TIMEOUT_S)
            if number:  # the first update sends everything, whatever its state
                times.setdefault(f"publish {state.name}", []).append(took)
            if state is State.UPDATED:
                received.append(took + (arrived - ended) / SECOND)
                for name, write in _writers(segmentation, markers).items():
                    times.setdefault(name, []).append(timed(write)[0])
    return {
        "points": len(segmentation.points),
        "ellipsoids": len(segmentation.ids),
        "publish_ms": milliseconds(times.pop(f"publish {State.UPDATED.name}")),
        "publish_unchanged_ms": milliseconds(times.pop(f"publish {State.UNCHANGED.name}")),
        "received_ms": milliseconds(received),
        "build_ms": {name: milliseconds(values) for name, values in times.items()},
        "bytes": {name: len(write()) for name, write in _writers(segmentation, markers).items()},
    }


def _publish(publisher: SegmentationPublisher, segmentation: Segmentation) -> int:
    """Publish an update; returns the monotonic time after it, ns."""
    publisher.publish(segmentation)
    return time.monotonic_ns()


def _writers(segmentation: Segmentation, markers: MarkerStream) -> dict[str, Callable[[], bytes]]:
    """The functions that serialize the message of each topic, with all markers."""
    return {
        "segmented_points": lambda: write_labelled(segmentation),
        "ellipsoids": lambda: markers.update(segmentation, send_all=True),
        "segments": lambda: write_segments(segmentation),
    }


def _many_ellipsoids(count: int) -> Segmentation:
    """A segmentation of `count` ellipsoids of 30 points, with the simulator's fields."""
    rng = np.random.default_rng(0)
    grid = np.stack(np.divmod(np.arange(count), 100), axis=1)
    centres = 3.0 * np.column_stack([grid, np.zeros(count)])  # m, more than their widths
    points = np.repeat(centres, POINTS_PER_ELLIPSOID, axis=0)
    points += 0.1 * rng.standard_normal(points.shape)
    fields = np.zeros(len(points), FIELDS)
    for name, column in zip("xyz", points.T, strict=True):
        fields[name] = column
    config = Config("parsimony", 1e9)  # merges everything that is connected
    segmentation = Segmenter(config).process(Sweep(SECOND, points, fields=fields, frame_id="odom"))
    if not 0.99 * count < len(segmentation.ids) < 1.01 * count:
        raise EllipsegError(
            f"{count} clusters gave {len(segmentation.ids)} segments; the benchmark is wrong"
        )
    return segmentation


def _next_update(segmentation: Segmentation, state: State) -> Segmentation:
    return replace(
        segmentation,
        sequence=segmentation.sequence + 1,
        end_ns=segmentation.end_ns + round(PERIOD * SECOND),
        state=np.full(len(segmentation.ids), state, np.uint8),
    )


# --- the node --------------------------------------------------------------------------------


def latency(sizes: Sizes, data: str = "") -> Section:
    """Latency from publishing a cloud to receiving its segments, 10 updates/s, real time."""
    window = sizes.window
    drive = simulate(SCENE, duration=window + sizes.listen)
    cases = [_latency(f"simulated {SCENE}", drive, window, sizes)]
    if data:
        source = open_source(data)
        share = RATE / points_per_second(source)
        stamps = [sweep.stamp_ns for sweep in source]
        span = (max(stamps) - min(stamps)) / SECOND
        sweeps = list(thinned(source, share))
        cases.append(_latency(source.name, sweeps, min(window, span / 2.0), sizes))
    return {"update_period_s": PERIOD, "cases": cases}


def _latency(name: str, sweeps: Iterable[Sweep], window: float, sizes: Sizes) -> Section:
    sent: dict[int, int] = {}  # newest point of a cloud, ns: time of publication, ns

    def note(sweep: Sweep) -> None:
        sent[int(sweep.times_ns.max(initial=sweep.stamp_ns))] = time.monotonic_ns()

    settings = {"update_period": PERIOD, "window_duration": float(window)}
    with running(RELIABLE | settings) as (listener, node, ros_args):
        with Replayer(sweeps, ReplayOptions(clock=False), ros_args) as replayer:
            listener.wait_for_topics(START_TIMEOUT_S)
            replayer.run(note)
            listener.wait_for_update(max(sent), UPDATE_TIMEOUT_S)
        report = listener.next_report(UPDATE_TIMEOUT_S)
        memory_mb = node.peak_memory_mb()
    full = min(sent) + round(window * SECOND)
    times = [
        (arrived - sent[stamp]) / SECOND
        for stamp, arrived in listener.updates.items()
        if stamp >= full and stamp in sent
    ]
    return {
        "stream": name,
        "window_s": round(window, 1),
        "points": int(report["points segmented"]) + int(report["points isolated"]),
        "clouds": sum(stamp >= full for stamp in sent),
        "latency_ms": _quantiles(times),
        "diagnostics_ms": {
            which: round(1e3 * float(report[f"latency {key} [s]"]), 1)
            for which, key in (("p50", "median"), ("p99", "p99"))
        },
        "updates_coalesced": int(report["updates coalesced"]),
        "clouds_lost": int(report["clouds lost by DDS"]),
        "peak_memory_mb": memory_mb,
    }


def _quantiles(seconds: list[float]) -> dict[str, Any]:
    p50, p99 = np.percentile(np.array(seconds) * 1e3, [50, 99])
    return {"p50": round(float(p50), 1), "p99": round(float(p99), 1), "updates": len(seconds)}


def memory(sizes: Sizes) -> Section:
    """Peak memory of the node at its default settings, with subscribers to all topics."""
    drive = simulate(SCENE, duration=sizes.window + 5.0)
    sweeps = list(thinned(drive, sizes.points / sizes.window / points_per_second(drive)))
    options = ReplayOptions(rate=0.0, clock=False, ahead=2.0, update_timeout=UPDATE_TIMEOUT_S)
    settings = {"window_duration": sizes.window}
    with running(RELIABLE | settings) as (listener, node, ros_args):
        with Replayer(sweeps, options, ros_args) as replayer:
            listener.wait_for_topics(START_TIMEOUT_S)
            replayer.run()
        report = listener.next_report(UPDATE_TIMEOUT_S)
        peak_mb = node.peak_memory_mb()
    points = int(report["points segmented"]) + int(report["points isolated"])
    return {"window_s": sizes.window, "points": points, "peak_mb": peak_mb}


def start(sizes: Sizes) -> Section:
    """Seconds from the start of the process until the node is ready, compiled and subscribed."""
    result: Section = {}
    with ExitStack() as stack:
        if sizes.cold:
            folder = stack.enter_context(tempfile.TemporaryDirectory())
            stack.enter_context(environment_variables({"NUMBA_CACHE_DIR": folder}))
            result["cold_s"] = spread([_start()])
        else:
            _start()
        result["warm_s"] = spread([_start() for _ in range(sizes.starts)])
    return result


def _start() -> float:
    """Seconds from the start of the process until the node logs that it is ready."""
    with isolated_ros_args("INFO") as ros_args, tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "node.log"
        os.mkfifo(log)  # a pipe delivers a line as soon as it is written
        ready: SimpleQueue[float | None] = SimpleQueue()
        Thread(target=_note_ready, args=(log, ready), daemon=True).start()
        with NodeProcess(ros_args, log, lambda _: None) as node:
            started = time.monotonic()
            node.start()
            finished = ready.get(timeout=START_TIMEOUT_S)
            if finished is None:
                raise EllipsegError("the node ended before it was ready; run it alone for its log")
            node.stop()
    return finished - started


def _note_ready(log: Path, ready: "SimpleQueue[float | None]") -> None:
    """Put the time at which the node logs that it is ready, and None at the end of the log."""
    with log.open() as lines:
        for line in lines:  # to the end, so that the pipe never blocks the node
            if READY in line:
                ready.put(time.monotonic())
    ready.put(None)
