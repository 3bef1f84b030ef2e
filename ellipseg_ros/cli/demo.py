"""`ellipseg demo`: replay a source to a node, record its output and verify it offline."""

import os
import sys
from argparse import Namespace
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

from ellipseg_ros.cli import isolation, report, results
from ellipseg_ros.cli.node_process import START_TIMEOUT_S, NodeProcess
from ellipseg_ros.cli.segment import run_updates
from ellipseg_ros.cli.settings import Settings, parameter_file, read_settings, with_settings
from ellipseg_ros.cli.sources import open_input
from ellipseg_ros.cli.verification import Verification, recorded_updates
from ellipseg_ros.io.atomic_files import write_text
from ellipseg_ros.io.bag import BagSink
from ellipseg_ros.io.sources import Source, as_odometry
from ellipseg_ros.node.grouping import Grouping
from ellipseg_ros.node.playback import ReplayOptions, ReplaySummary
from ellipseg_ros.poses.placer import Event, Outcome, Placer
from ellipseg_ros.records import Sweep
from ellipseg_ros.ros.recorder import Recorder
from ellipseg_ros.ros.replayer import Replayer
from ellipseg_ros.segmenter import warm_up

MAX_POINTS_PER_SECOND = 10_000  # which two cores segment in real time, with the default window
# Without these, ids and segments may differ from those of the offline run.
REPRODUCIBLE = {"max_backlog": 0, "input_reliability": "reliable", "auto_tune_period": 0.0}
AHEAD = 2.0  # update periods that the replayer may be ahead of the node
UPDATE_TIMEOUT_S = 120.0
MAX_PROBLEMS = 5  # printed

NEXT_STEPS = """
Look at {folder}/segments.png and ellipsoids.png; replay {folder}/bag:
  Foxglove   open {folder}/bag/bag.mcap, 3D panel, topics /segmented_points and /ellipsoids
  RViz       ros2 bag play {folder}/bag, and rviz2 -d config/ellipseg.rviz"""


class LiveRun(NamedTuple):
    """The run of the node."""

    sent: ReplaySummary
    updates: int  # expected of the node
    diagnostics: dict[str, str]  # the last ones
    peak_memory_mb: float

    def milliseconds(self, name: str) -> dict[str, float]:
        """Median and 99th percentile of a time in the diagnostics."""
        values = {q: self.diagnostics.get(f"{name} {q} [s]") for q in ("median", "p99")}
        return {q: round(float(value) * 1e3, 1) for q, value in values.items() if value}


def run(args: Namespace) -> int:
    """Run, verify and report; returns the exit code, 1 if the verification failed."""
    results.require_plots(args)
    settings = read_settings(args)
    source = as_odometry(open_input(args.data, args, settings.placement))
    defaults = {"max_points_per_second": MAX_POINTS_PER_SECOND} if source.duration else {}
    settings = with_settings(read_settings(args, defaults), REPRODUCIBLE)
    settings = replace(settings, placement=source.placement)
    folder = Path(args.output)
    results.prepare(folder, args.data)
    with isolation.reserved_domain() as number:
        domain = {"ROS_DOMAIN_ID": os.environ.get("ROS_DOMAIN_ID", str(number))}
        with isolation.environment_variables(isolation.LOCALHOST_ONLY | domain):
            live = _run_node(source, settings, folder, args)
    verification, meter = _verify(source, settings, folder, live, args)
    summary = report.heading(args.data, source.frame_id, settings)
    summary |= meter.counts(live.sent.wall_seconds) | {
        "updates": verification.updates,
        "points": live.sent.points,
        "update_ms": live.milliseconds("processing"),
        "latency_ms": live.milliseconds("latency"),
        "peak_memory_mb": live.peak_memory_mb,
        "checks": verification.summary(),
        "passed": verification.passed,
        "problems": verification.problems,
        "node": live.diagnostics,
    }
    results.finish(folder, summary, meter.last, args)
    if meter.last is not None and meter.last.counts.thinned:
        rate = settings.config.max_points_per_second
        report.print_status(f"The clouds were thinned: max_points_per_second = {rate:,}.", args)
    if not verification.passed:
        lines = ["ellipseg: the verification failed", *verification.problems[:MAX_PROBLEMS]]
        print("\n".join(lines), file=sys.stderr)
        return 1
    report.print_status(NEXT_STEPS.format(folder=folder), args)
    return 0


def _run_node(source: Source, settings: Settings, folder: Path, args: Namespace) -> LiveRun:
    """Start the node, send it all clouds, and record its output."""
    name = f"/demo_{os.getpid()}"  # the domain may have other nodes
    namespace = ["--ros-args", "-r", f"__ns:={name}", "-r", f"/diagnostics:={name}/diagnostics"]
    client_args = [*namespace, "--log-level", "warn"]
    parameters = folder / results.PARAMETERS
    write_text(parameters, parameter_file(settings.flat()))
    period = settings.config.update_period
    options = ReplayOptions(rate=0.0, clock=False, update_timeout=UPDATE_TIMEOUT_S)
    options = replace(options, ahead=AHEAD * period, update_period=period)
    with ExitStack() as stack:
        bag = stack.enter_context(BagSink(folder / results.BAG, settings.node))
        recorder = stack.enter_context(Recorder(bag, client_args))
        events = Observed(source, recorder, Grouping(settings.config))
        replayer = stack.enter_context(Replayer(events, options, client_args, source.placement))

        def abort(reason: str) -> None:
            recorder.stop(reason)
            replayer.stop()

        text = "starting the node, which compiles its kernels the first time ..."
        report.print_status(text, args)
        node_args = [*namespace, "--params-file", str(parameters)]
        node = stack.enter_context(NodeProcess(node_args, folder / results.LOG, abort))
        node.start()
        recorder.wait_for_topics(START_TIMEOUT_S)
        bar = stack.enter_context(report.progress_bar(source.count, "clouds", args))
        sent = replayer.run(lambda _: bar.update())
        # No cloud reaches the end of the last update period; a reset ends it.
        recorder.wait_for_report("clouds received", sent.clouds, UPDATE_TIMEOUT_S)
        recorder.reset_segmenter(UPDATE_TIMEOUT_S)
        recorder.wait_for_updates(events.updates, UPDATE_TIMEOUT_S)
        recorder.wait_for_report("updates", events.updates, UPDATE_TIMEOUT_S)
        live = LiveRun(sent, events.updates, recorder.diagnostics, node.peak_memory_mb())
        node.stop()
    return live


@dataclass
class Observed:
    """The events of a source; each is recorded, and counted in the updates that it leads to."""

    source: Source
    recorder: Recorder
    grouping: Grouping
    updates: int = 0  # expected of the node

    def __iter__(self) -> Iterator[Event]:
        placer = Placer(self.source.placement)
        for event in self.source.events:
            yield event
            self.recorder.write_event(event)
            self._count(placer.take(event))
        self._count(placer.flush())
        self.updates += len(self.grouping.flush())

    def _count(self, outcomes: Iterable[Outcome]) -> None:
        sweeps = (outcome for outcome in outcomes if isinstance(outcome, Sweep))
        self.updates += sum(len(self.grouping.push(sweep)) for sweep in sweeps)


def _verify(
    source: Source, settings: Settings, folder: Path, live: LiveRun, args: Namespace
) -> tuple[Verification, report.Meter]:
    """Segment the source offline, and compare every update with that of the node."""
    report.print_status("verifying: segmenting the same clouds offline ...", args)
    warm_up()
    all_kept = settings.config.resolution == 0.0
    verification = Verification(live.updates, settings.node, all_kept)
    meter = report.Meter()
    recorded = recorded_updates(folder / results.BAG)
    with report.progress_bar(live.updates, "updates", args) as bar:
        offline = run_updates(source, settings.config, meter)
        for (group, result), node in zip(offline, recorded, strict=False):
            verification.update(group, result, node)
            bar.update()
    return verification, meter
