"""The node and a subscriber beside it, each in a process of its own, apart from everybody else."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from ellipseg_ros.cli.domains import claimed_domain
from ellipseg_ros.cli.node_process import NodeProcess
from studies.endurance.listener_process import Listening

LOCAL = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
START = 180.0  # s: imports, and the first compilation of all kernels


@contextmanager
def running(settings: dict[str, Any]) -> Iterator[tuple[Listening, NodeProcess, list[str]]]:
    """The node and a subscriber, each in a process of its own, and `--ros-args` to reach them."""
    with ExitStack() as stack:
        ros_args = stack.enter_context(domain())
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        listener = stack.enter_context(Listening(ros_args))
        args = [*ros_args, *parameters(settings)]
        node = stack.enter_context(NodeProcess(args, folder / "node.log", listener.give_up))
        node.start()
        yield listener, node, ros_args
        node.stop()


def parameters(settings: dict[str, Any]) -> list[str]:
    """Settings as words that follow `--ros-args`."""
    return [item for pair in settings.items() for item in ("-p", "{}:={}".format(*pair))]


@contextmanager
def domain(log_level: str = "WARN") -> Iterator[list[str]]:
    """This machine only, in a domain and a namespace of our own; yields the arguments for it."""
    with claimed_domain() as number, environment(LOCAL | {"ROS_DOMAIN_ID": str(number)}):
        yield ["--ros-args", "-r", f"__ns:=/measured_{os.getpid()}", "--log-level", log_level]


@contextmanager
def environment(values: dict[str, str]) -> Iterator[None]:
    """Environment variables for this block, and for the processes that it starts."""
    before = dict(os.environ)
    os.environ.update(values)
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)
