"""PointCloud2 messages as plain objects, and their bytes, consistent or not."""

from dataclasses import dataclass

import numpy as np

from ellipseg_ros.io.cdr import Cdr
from ellipseg_ros.io.pointcloud2 import TYPES
from ellipseg_ros.records import SECOND

START_NS = 1_700_000_000 * SECOND  # stamp of the first cloud


@dataclass(frozen=True)
class Time:
    """builtin_interfaces/Time."""

    sec: int
    nanosec: int


@dataclass(frozen=True)
class Header:
    """std_msgs/Header."""

    stamp: Time
    frame_id: str


@dataclass(frozen=True)
class Field:
    """sensor_msgs/PointField."""

    name: str
    offset: int
    datatype: int
    count: int

    @property
    def size(self) -> int:
        """Bytes."""
        return self.count * np.dtype(TYPES[self.datatype]).itemsize


@dataclass(frozen=True)
class Cloud:
    """sensor_msgs/PointCloud2."""

    header: Header
    height: int
    width: int
    fields: list[Field]
    is_bigendian: bool
    point_step: int
    row_step: int
    data: bytes
    is_dense: bool


def large_cloud(points: int, seed: int = 0) -> Cloud:
    """A wall with 300 points/m^2 and an intensity, with a stamp later than those of odd clouds."""
    rng = np.random.default_rng([seed, points])
    fields = [Field(name, 4 * k, 7, 1) for k, name in enumerate(("x", "y", "z", "intensity"))]
    values = rng.random((points, 4), dtype=np.float32)
    values[:, :2] *= np.float32(np.sqrt(points / 300.0))
    values[:, 2] *= 0.02
    header = Header(Time(START_NS // SECOND + 10**7, 0), "odom")
    data = values.tobytes()
    return Cloud(header, 1, points, fields, False, 16, 16 * points, data, True)


def serialized(cloud: Cloud) -> bytes:
    """The message as bytes, consistent or not."""
    out = Cdr()
    out.put("iI", cloud.header.stamp.sec, cloud.header.stamp.nanosec)
    out.text(cloud.header.frame_id)
    out.put("II", cloud.height, cloud.width)
    out.put("I", len(cloud.fields))
    for field in cloud.fields:
        out.text(field.name)
        out.put("IBI", field.offset, field.datatype, field.count)
    out.put("?II", cloud.is_bigendian, cloud.point_step, cloud.row_step)
    out.put("I", len(cloud.data))
    out.bulk(cloud.data)
    out.put("?", cloud.is_dense)
    return out.bytes()
