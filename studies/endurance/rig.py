"""A drive that is replayed endlessly to segmenters that a test starts and kills."""

import math
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path
from threading import Thread

from ellipseg_ros.cli.node_process import START_TIMEOUT_S, NodeProcess
from ellipseg_ros.node.playback import ReplayOptions
from ellipseg_ros.records import SECOND
from ellipseg_ros.ros.replayer import Replayer
from studies.endurance.endless_drive import EndlessDrive
from studies.endurance.ros.recording_subscriber import ReceivedUpdate, RecordingSubscriber
from studies.endurance.running import NODE_LOG, SendTimes
from studies.report.isolated_nodes import isolated_ros_args, parameter_args

UPDATE_PERIOD = 0.5  # s
SETTINGS = {"window_duration": 3.0, "update_period": UPDATE_PERIOD, "full_segments_period": 4.0}


@dataclass
class Rig:
    """A replayer and a recording subscriber; moments are s of the monotonic clock."""

    ros_args: list[str]
    subscriber: RecordingSubscriber
    folder: Path
    sent: SendTimes = field(default_factory=SendTimes)

    @contextmanager
    def node(self, *more: str) -> Iterator[NodeProcess]:
        """A segmenter, ended with the block; more: words after `--ros-args`."""
        args = [*self.ros_args, *parameter_args(SETTINGS), *more]
        with NodeProcess(args, self.folder / NODE_LOG, lambda _: None) as process:
            process.start()
            yield process

    def wait_for_updates(self, moment: float, count: int = 1) -> float:
        """Time from `moment` until `count` updates have arrived in sync, s."""

        def arrived() -> list[ReceivedUpdate]:
            return [update for update in self.subscriber.since(moment) if update.in_sync]

        self.subscriber.wait(lambda: len(arrived()) >= count, START_TIMEOUT_S, "no update came")
        return arrived()[count - 1].time - moment

    def updates_of_new_node(self, moment: float) -> list[ReceivedUpdate]:
        """Updates of the node that was started at `moment`.

        Messages of a dead node may arrive later, but they are of clouds that were sent before.
        """
        return [
            update
            for update in self.subscriber.since(moment)
            if self._is_sent_after(update.stamp_ns, moment)
        ]

    def stale_markers_of_new_node(self, moment: float) -> list[bool]:
        """For each message of markers of that node, whether older markers stayed displayed."""
        messages = self.subscriber.marker_updates
        return [stale for stamp, stale in messages if self._is_sent_after(stamp, moment)]

    def wait_for_new_node(self, moment: float) -> float:
        """Time from the start of a node at `moment` until its first update in sync, s."""

        def arrived() -> list[ReceivedUpdate]:
            return [update for update in self.updates_of_new_node(moment) if update.in_sync]

        def done() -> bool:
            return bool(arrived() and self.stale_markers_of_new_node(moment))

        self.subscriber.wait(done, START_TIMEOUT_S, "no update came")
        return arrived()[0].time - moment

    def latencies(self, moment: float) -> list[float]:
        """Of the updates since `moment`, s: from the newest cloud sent to segments received."""
        updates = self.subscriber.since(moment)
        return [update.time - self.sent[update.stamp_ns] / SECOND for update in updates]

    def sequence(self) -> list[int]:
        """Numbers of the updates; one that is sent again for a late subscriber counts once."""
        return [number for number, _ in groupby(u.sequence for u in self.subscriber.updates)]

    def _is_sent_after(self, stamp_ns: int, moment: float) -> bool:
        return self.sent.get(stamp_ns, -math.inf) / SECOND > moment


def is_unbroken(sequence: list[int]) -> bool:
    """Whether each number is one more than the one before."""
    return sequence == list(range(sequence[0], sequence[0] + len(sequence)))


@contextmanager
def rig(seed: int, replays: bool = True) -> Iterator[Rig]:
    """A rig without a segmenter; replays: with a replayer."""
    with ExitStack() as stack:
        ros_args = stack.enter_context(isolated_ros_args("FATAL"))
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        subscriber = stack.enter_context(RecordingSubscriber(ros_args))
        test_rig = Rig(ros_args, subscriber, folder)
        if replays:
            drive = EndlessDrive(4.0, 10_000, seed=seed)
            replayer = stack.enter_context(Replayer(drive, ReplayOptions(clock=False), ros_args))
            thread = Thread(
                target=replayer.run, args=[test_rig.sent.note], name="replay", daemon=True
            )
            thread.start()
            stack.callback(thread.join)
            stack.callback(replayer.stop)
        yield test_rig
