"""Clouds of Livox drivers: their CustomMsg, which is no PointCloud2."""

from typing import Any

import numpy as np

from ellipseg_ros.io.limits import check_name, read_stamp
from ellipseg_ros.io.pointcloud2 import xyz
from ellipseg_ros.poses.point_times import time_offsets
from ellipseg_ros.records import Sweep

CUSTOM_CLOUDS = ("livox_ros_driver2/msg/CustomMsg", "livox_ros_driver/msg/CustomMsg")
FIELDS = [
    ("x", "f4"),
    ("y", "f4"),
    ("z", "f4"),
    ("offset_time", "u4"),  # ns from the stamp
    ("reflectivity", "u1"),
    ("tag", "u1"),
    ("line", "u1"),
]


def read_custom_cloud(msg: Any) -> Sweep:
    """The points of a CustomMsg, with its fields; InputError if the stamp or frame is invalid."""
    stamp_ns = read_stamp(msg.header.stamp)
    check_name("frame_id", msg.header.frame_id)
    rows = [tuple(getattr(point, name) for name, _ in FIELDS) for point in msg.points]
    fields = np.array(rows, FIELDS)
    offsets = time_offsets(fields, stamp_ns)
    return Sweep(stamp_ns, xyz(fields), offsets, fields, msg.header.frame_id)
