"""`ellipseg demo`: the node in a process of its own, a recording sent to it, all of it checked."""

import os
import sys
from argparse import Namespace
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from ellipseg_ros.cli.check import Check, received
from ellipseg_ros.cli.domains import claimed_domain
from ellipseg_ros.cli.node_process import NodeProcess
from ellipseg_ros.cli.report import (
    Meter,
    Progress,
    Summary,
    heading,
    progress,
    say,
    show,
    window_summary,
)
from ellipseg_ros.cli.results import BAG, LOG, PARAMETERS, finish, prepare
from ellipseg_ros.cli.running import LOCAL, environment
from ellipseg_ros.cli.segment import run_updates
from ellipseg_ros.cli.settings import Settings, read_settings, with_settings
from ellipseg_ros.cli.sources import open_input
from ellipseg_ros.io.atomic_files import write_text
from ellipseg_ros.io.bag import BagSink
from ellipseg_ros.io.sources import Source
from ellipseg_ros.node.grouping import Grouping
from ellipseg_ros.node.playback import ReplayOptions, ReplaySummary
from ellipseg_ros.records import SECOND, Sweep
from ellipseg_ros.ros.parameters import as_yaml
from ellipseg_ros.ros.recorder import Recorder
from ellipseg_ros.ros.replayer import Replayer
from ellipseg_ros.segmenter import warm_up

THINNED_TO = 10_000  # points/s that two cores take in real time
LOSSLESS = {"max_backlog": 0, "input_reliability": "reliable"}  # else ids may differ from offline
STEADY = {"auto_tune_period": 0.0}  # likewise, segments
AHEAD = 2.0  # update periods that the replayer may be ahead of the node
START = 120.0  # s: imports, and the first compilation of all kernels
PATIENCE = 120.0  # s for one update

OPEN = """
Look at {folder}/segments.png and ellipsoids.png; replay {folder}/bag:
  Foxglove   open {folder}/bag/bag.mcap, 3D panel, topics /segmented_points and /ellipsoids
  RViz       ros2 bag play {folder}/bag, and rviz2 -d config/ellipseg.rviz"""


@dataclass(frozen=True)
class Live:
    """What the run over DDS was like."""

    sent: ReplaySummary
    updates: int  # that the node had to make
    node: dict[str, str]  # its last diagnostics
    peak_memory_mb: float  # of the node


def run(args: Namespace) -> int:
    """Run, check and report; returns the exit code, 1 if a check failed."""
    source = open_input(args.data, args)
    defaults = {"max_points_per_second": THINNED_TO} if source.duration else {}  # no single cloud
    settings = with_settings(read_settings(args, defaults), LOSSLESS | STEADY)
    folder = Path(args.output)
    prepare(folder, args.data)
    with _to_ourselves():
        live = _replay(source, settings, folder, args)
    check, meter = _check(source, settings, folder, live, args)
    summary = _summary(heading(args.data, source.frame_id, settings), live, check, meter)
    finish(folder, summary, meter.last, args)
    show(summary, args)
    if meter.last is not None and meter.last.counts.thinned:
        rate = settings.config.max_points_per_second
        say(f"The clouds are dense, so they were thinned: max_points_per_second = {rate:,}.", args)
    if not check.passed:
        print("\n".join(["ellipseg: the check failed", *check.problems[:5]]), file=sys.stderr)
        return 1
    say(OPEN.format(folder=folder), args)
    return 0


@contextmanager
def _to_ourselves() -> Iterator[None]:
    """This machine only; a domain of our own, unless the user names one, to watch it there."""
    with ExitStack() as stack:
        stack.enter_context(environment(LOCAL))
        if "ROS_DOMAIN_ID" not in os.environ:
            number = stack.enter_context(claimed_domain())
            stack.enter_context(environment({"ROS_DOMAIN_ID": str(number)}))
        yield


def _replay(source: Source, settings: Settings, folder: Path, args: Namespace) -> Live:
    """Start the node, send it everything, and record what it publishes."""
    name = f"/demo_{os.getpid()}"  # others may share the domain
    namespace = ["--ros-args", "-r", f"__ns:={name}", "-r", f"/diagnostics:={name}/diagnostics"]
    ours = [*namespace, "--log-level", "warn"]
    parameters = folder / PARAMETERS
    write_text(parameters, as_yaml(settings.config, settings.node))
    with ExitStack() as stack:
        bag = stack.enter_context(BagSink(folder / BAG, settings.node))
        recorder = stack.enter_context(Recorder(bag, ours))
        replayer = stack.enter_context(Replayer(source, _options(settings), ours))

        def give_up(reason: str) -> None:
            recorder.stop(reason)
            replayer.stop()

        say("starting the node, which compiles its kernels the first time ...", args)
        node_args = [*namespace, "--params-file", str(parameters)]
        node = stack.enter_context(NodeProcess(node_args, folder / LOG, give_up))
        node.start()
        recorder.wait_for_topics(START)
        bar = stack.enter_context(progress(source.count, "clouds", args))
        sent, updates = _send(replayer, recorder, settings, bar)
        recorder.wait_for_updates(updates, PATIENCE)
        recorder.wait_for_report("updates", updates, PATIENCE)
        live = Live(sent, updates, recorder.diagnostics, node.peak_memory_mb())
        node.stop()
    return live


def _options(settings: Settings) -> ReplayOptions:
    period = settings.config.update_period
    return ReplayOptions(
        rate=0.0, clock=False, ahead=AHEAD * period, update_period=period, patience=PATIENCE
    )


def _send(
    replayer: Replayer, recorder: Recorder, settings: Settings, bar: Progress
) -> tuple[ReplaySummary, int]:
    """Send everything; returns what was sent, and how many updates the node must make of it."""
    grouping = Grouping(settings.config)
    updates = 0

    def one(sweep: Sweep) -> None:
        nonlocal updates
        recorder.write_points(sweep)
        updates += len(grouping.push(sweep))
        bar.update()

    sent = replayer.run(one)
    # The last points wait for a boundary that no cloud reaches; a reset makes an update of them.
    recorder.wait_for_report("clouds received", sent.clouds, PATIENCE)
    recorder.reset_segmenter(PATIENCE)
    return sent, updates + len(grouping.flush())


def _check(
    source: Source, settings: Settings, folder: Path, live: Live, args: Namespace
) -> tuple[Check, Meter]:
    """Segment the source offline, and compare update by update with what the node published."""
    say("checking: the same offline ...", args)
    warm_up()
    check, meter = Check(live.updates, settings.node), Meter()
    with progress(live.updates, "updates", args) as bar:
        node = received(folder / BAG)
        for group, found in run_updates(source, settings.config, meter):
            said = next(node, None)
            if said is None:
                break
            check.update(group, found, said)
            bar.update()
    return check, meter


def _summary(head: Summary, live: Live, check: Check, meter: Meter) -> Summary:
    """What the node did; the window is the last one."""
    sent = live.sent
    sensor = meter.sensor_ns / SECOND
    return head | {
        "updates": check.updates,
        "restarts": meter.restarts,
        "points": sent.points,
        "points_late": meter.late,
        "points_expired_early": meter.evicted,
        "sensor_s": round(sensor, 3),
        "wall_s": round(sent.wall_seconds, 3),
        "times_real_time": round(sensor / sent.wall_seconds, 2) if sensor else None,
        "update_ms": _milliseconds(live.node, "processing"),
        "latency_ms": _milliseconds(live.node, "latency"),
        "peak_memory_mb": live.peak_memory_mb,
        "window": window_summary(meter.last) if meter.last else None,
        "checks": check.summary(),
        "passed": check.passed,
        "problems": check.problems,
        "node": live.node,
    }


def _milliseconds(node: dict[str, str], name: str) -> dict[str, float]:
    """Median and p99 of a time that the node reports in s."""
    keys = {which: f"{name} {which} [s]" for which in ("median", "p99")}
    return {which: round(float(node[key]) * 1e3, 1) for which, key in keys.items() if key in node}
