"""ROS arguments and environment that isolate a node from other ROS programs."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from ellipseg_ros.cli.domains import claimed_domain

LOCAL = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
START = 180.0  # s: imports, and the first compilation of all kernels


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
