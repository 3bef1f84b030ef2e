"""A process that tells whether ROS, all messages and their type support load: it may not survive.

With an RMW_IMPLEMENTATION that is not there, rcl ends the process that loads it, with code 102.
"""

import json
import sys
from importlib import import_module

import rclpy
from rclpy.type_support import check_for_type_support

PACKAGES = (
    "builtin_interfaces",
    "diagnostic_msgs",
    "geometry_msgs",
    "rcl_interfaces",
    "rosgraph_msgs",
    "sensor_msgs",
    "std_msgs",
    "visualization_msgs",
)
OURS = ("Association", "LandmarkArray", "SegmentArray", "TuningCurve")  # the others are in them


def problem() -> str:
    """What is wrong with the messages, in one line; empty if nothing is."""
    try:
        for package in PACKAGES:
            import_module(f"{package}.msg")
        import_module("std_srvs.srv")
        messages = import_module("ellipseg_ros.msg")
        for name in OURS:
            check_for_type_support(getattr(messages, name))
    except Exception as error:  # ImportError, UnsupportedTypeSupport, AttributeError, OSError
        return f"messages do not load: {type(error).__name__}: {' '.join(str(error).split())}"
    return ""


def main() -> int:
    """Tell in a line of JSON: the middleware that ROS has loaded, and what is wrong."""
    told = {"middleware": rclpy.get_rmw_implementation_identifier(), "problem": problem()}
    sys.stdout.write(json.dumps(told) + "\n")
    return 0
