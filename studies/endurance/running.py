"""The node and a subscriber, each in a process of its own, isolated from other ROS programs."""

import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from ellipseg_ros.cli.isolation import isolated_ros_args, parameter_args
from ellipseg_ros.cli.node_process import NodeProcess
from studies.endurance.listener_process import Listening


@contextmanager
def running(settings: dict[str, Any]) -> Iterator[tuple[Listening, NodeProcess, list[str]]]:
    """The node and a subscriber, each in a process of its own, and `--ros-args` to reach them."""
    with ExitStack() as stack:
        ros_args = stack.enter_context(isolated_ros_args())
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        listener = stack.enter_context(Listening(ros_args))
        args = [*ros_args, *parameter_args(settings)]
        node = stack.enter_context(NodeProcess(args, folder / "node.log", listener.give_up))
        node.start()
        yield listener, node, ros_args
        node.stop()
