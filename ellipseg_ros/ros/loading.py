"""Whether ROS, the packages of messages and our own messages load, type support and all."""

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


def middleware() -> str:
    """The implementation that ROS has loaded; RuntimeError if it can't."""
    return str(rclpy.get_rmw_implementation_identifier())


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
