"""A process that checks whether ROS, all messages and their type support can be loaded.

It is a process of its own because rcl exits with code 102 if the library of RMW_IMPLEMENTATION is
missing.
"""

import json
import sys

import rclpy
from rclpy.type_support import check_for_type_support

from ellipseg_ros.io.topics import SERVICES, TOPICS
from ellipseg_ros.ros.topics import interface_class


def problem() -> str:
    """The problem with the messages in one line; empty if there is none."""
    try:
        for interface in (*TOPICS, *SERVICES):
            check_for_type_support(interface_class(interface.type))
    except Exception as error:  # ImportError, UnsupportedTypeSupport, AttributeError, OSError
        return f"messages do not load: {type(error).__name__}: {' '.join(str(error).split())}"
    return ""


def main() -> int:
    """Print a line of JSON with the loaded middleware and the problem, if any."""
    result = {"middleware": rclpy.get_rmw_implementation_identifier(), "problem": problem()}
    sys.stdout.write(json.dumps(result) + "\n")
    return 0
