"""Clouds through the node as fast as it can, none lost, all that it publishes recorded."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from ellipseg_ros.cli.isolation import isolated_ros_args, parameter_args
from ellipseg_ros.cli.node_process import START_TIMEOUT_S, NodeProcess
from ellipseg_ros.config import Config
from ellipseg_ros.node.playback import ReplayOptions
from ellipseg_ros.records import Sweep
from ellipseg_ros.ros.recorder import Recorder, Sink
from ellipseg_ros.ros.replayer import Replayer

PATIENCE = 120.0  # s for one update


@dataclass(frozen=True)
class Lossless:
    """The three who take part, each ready."""

    replayer: Replayer
    recorder: Recorder
    node: NodeProcess
    ros_args: list[str]  # with which others join
    log: Path  # of the node

    def finish(self, updates: int) -> dict[str, str]:
        """Wait for so many updates, end the node, and return its last diagnostics."""
        self.recorder.wait_for_updates(updates, PATIENCE)
        self.recorder.wait_for_report("updates", updates, PATIENCE)
        said = self.recorder.diagnostics
        self.node.stop()
        return said


@contextmanager
def lossless(
    source: Iterable[Sweep], config: Config, sink: Sink, settings: dict[str, Any]
) -> Iterator[Lossless]:
    """Start them; settings: parameters of the node, other than those that nothing is lost with."""
    period = config.update_period
    options = ReplayOptions(
        rate=0.0, clock=False, ahead=2.0 * period, update_period=period, update_timeout=PATIENCE
    )
    given = parameter_args({"max_backlog": 0, "input_reliability": "reliable"} | settings)
    with (
        isolated_ros_args() as ros_args,
        TemporaryDirectory() as folder,
        Recorder(sink, ros_args) as recorder,
        Replayer(source, options, ros_args) as replayer,
    ):

        def give_up(reason: str) -> None:
            recorder.stop(reason)
            replayer.stop()

        log = Path(folder) / "node.log"
        with NodeProcess([*ros_args, *given], log, give_up) as node:
            node.start()
            recorder.wait_for_topics(START_TIMEOUT_S)
            yield Lossless(replayer, recorder, node, ros_args, log)
