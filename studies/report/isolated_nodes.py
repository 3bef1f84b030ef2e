"""ROS arguments of nodes that a study isolates from other ROS programs."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from ellipseg_ros.cli.isolation import LOCALHOST_ONLY, environment_variables, reserved_domain


@contextmanager
def isolated_ros_args(log_level: str = "WARN") -> Iterator[list[str]]:
    """Restrict ROS to this machine and a reserved domain; yield `--ros-args` with a namespace."""
    with (
        reserved_domain() as number,
        environment_variables(LOCALHOST_ONLY | {"ROS_DOMAIN_ID": str(number)}),
    ):
        yield ["--ros-args", "-r", f"__ns:=/measured_{os.getpid()}", "--log-level", log_level]


def parameter_args(settings: dict[str, Any]) -> list[str]:
    """Parameters as arguments after `--ros-args`."""
    return [word for name, value in settings.items() for word in ("-p", f"{name}:={value}")]
