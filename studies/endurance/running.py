"""Segmenter, subscriber and replayer for a study, isolated from other ROS programs."""

import tempfile
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from ellipseg_ros.cli.node_process import START_TIMEOUT_S, NodeProcess
from ellipseg_ros.config import Config
from ellipseg_ros.node.playback import ReplayOptions
from ellipseg_ros.records import Sweep
from ellipseg_ros.ros.recorder import Recorder, Sink
from ellipseg_ros.ros.replayer import Replayer
from studies.endurance.subscriber_process import SubscriberProcess
from studies.report.isolated_nodes import isolated_ros_args, parameter_args

UPDATE_TIMEOUT_S = 120.0
NODE_LOG = "node.log"


class Session(NamedTuple):
    """A running segmenter and a subscriber to all of its topics, each a process."""

    subscriber: SubscriberProcess
    node: NodeProcess
    ros_args: list[str]  # of other nodes that join


class SendTimes(dict[int, int]):
    """When clouds were sent: the newest point time of each, and the monotonic time; both ns."""

    def note(self, sweep: Sweep) -> None:
        """Note that a cloud was sent."""
        self[newest_time(sweep)] = time.monotonic_ns()


def newest_time(sweep: Sweep) -> int:
    """Time of the newest point, ns; that of the sweep if it has no points."""
    return int(sweep.times_ns.max(initial=sweep.stamp_ns))


@contextmanager
def running(settings: dict[str, Any]) -> Iterator[Session]:
    """A segmenter with these parameters, and a subscriber."""
    with (
        isolated_ros_args() as ros_args,
        tempfile.TemporaryDirectory() as folder,
        SubscriberProcess(ros_args) as subscriber,
    ):
        log, args = Path(folder) / NODE_LOG, [*ros_args, *parameter_args(settings)]
        with NodeProcess(args, log, subscriber.abort) as node:
            node.start()
            yield Session(subscriber, node, ros_args)
            node.stop()


@contextmanager
def connected_replayer(
    session: Session, source: Iterable[Sweep], options: ReplayOptions | None = None
) -> Iterator[Replayer]:
    """A replayer for the segmenter of a session, once the subscriber is connected to it."""
    with Replayer(source, options or ReplayOptions(clock=False), session.ros_args) as replayer:
        session.subscriber.wait_for_topics(START_TIMEOUT_S)
        yield replayer


def as_fast_as_processed(config: Config) -> ReplayOptions:
    """Options of a replay that waits for the segmenter's updates."""
    period = config.update_period
    ahead = 2.0 * period
    return ReplayOptions(
        rate=0.0, clock=False, ahead=ahead, update_period=period, update_timeout=UPDATE_TIMEOUT_S
    )


@dataclass(frozen=True)
class LosslessSession:
    """A replayer, a segmenter that drops nothing, and a recorder of all that it publishes."""

    replayer: Replayer
    recorder: Recorder
    node: NodeProcess
    ros_args: list[str]  # of other nodes that join
    log: Path  # of the segmenter

    def finish(self, updates: int) -> dict[str, str]:
        """Wait for that many updates, end the node, and return its last diagnostics."""
        self.recorder.wait_for_updates(updates, UPDATE_TIMEOUT_S)
        self.recorder.wait_for_report("updates", updates, UPDATE_TIMEOUT_S)
        report = self.recorder.diagnostics
        self.node.stop()
        return report


@contextmanager
def lossless(
    source: Iterable[Sweep], config: Config, sink: Sink, settings: dict[str, Any]
) -> Iterator[LosslessSession]:
    """Replayer, segmenter and recorder, connected.

    config: of the segmenter, of which `settings` are those parameters that are not defaults.
    """
    given = parameter_args({"max_backlog": 0, "input_reliability": "reliable"} | settings)
    with (
        isolated_ros_args() as ros_args,
        tempfile.TemporaryDirectory() as folder,
        Recorder(sink, ros_args) as recorder,
        Replayer(source, as_fast_as_processed(config), ros_args) as replayer,
    ):

        def abort(reason: str) -> None:
            recorder.stop(reason)
            replayer.stop()

        log = Path(folder) / NODE_LOG
        with NodeProcess([*ros_args, *given], log, abort) as node:
            node.start()
            recorder.wait_for_topics(START_TIMEOUT_S)
            yield LosslessSession(replayer, recorder, node, ros_args, log)
