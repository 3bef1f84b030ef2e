"""Poses and transforms from messages, of rclpy or of rosbags, and to serialized messages."""

from typing import Any

import numpy as np

from ellipseg_ros.errors import InputError
from ellipseg_ros.io.limits import SHOWN_LENGTH, check_name, read_stamp
from ellipseg_ros.io.topics import ODOMETRY, TF_MESSAGE, TF_STATIC
from ellipseg_ros.poses.placer import Event, RefusedPose, TransformSample
from ellipseg_ros.poses.series import PoseSample
from ellipseg_ros.poses.transforms import Transform, transform
from ellipseg_ros.records import SECOND

POSE_TYPES = (
    ODOMETRY.type,
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
)
TRANSFORM_TYPES = (TF_MESSAGE, "tf/msg/tfMessage")  # of tf2, and the same of tf in ROS 1


def read_poses(msg: Any, topic: str, kind: str) -> list[Event]:
    """The pose or the transforms of a message of one of the POSE_TYPES or TRANSFORM_TYPES."""
    if kind in TRANSFORM_TYPES:
        return [*read_transforms(msg, topic == TF_STATIC.name)]
    try:
        return [read_odometry(msg)]
    except InputError as error:
        return [RefusedPose(error.reason, f"{topic}: {error}")]


def read_odometry(msg: Any) -> PoseSample:
    """The pose of one of the POSE_TYPES; InputError, in one line, if it is invalid.

    A PoseStamped names no child frame: it is taken as the pose of the sensor.
    """
    pose = msg.pose.pose if hasattr(msg.pose, "pose") else msg.pose
    child = getattr(msg, "child_frame_id", None)
    if child == "":
        problem = "the odometry has no child_frame_id"
        raise InputError(f"{problem}; it must name the frame of its pose", "odometry_frame")
    return _sample(msg.header, child or "", pose.position, pose.orientation)


def read_transforms(msg: Any, static: bool) -> list[TransformSample | RefusedPose]:
    """The transforms of a tf2_msgs/TFMessage, each on its own: one may be invalid."""
    return [_read_transform(stamped, static) for stamped in msg.transforms]


def _read_transform(stamped: Any, static: bool) -> TransformSample | RefusedPose:
    moved = stamped.transform
    try:
        sample = _sample(stamped.header, stamped.child_frame_id, moved.translation, moved.rotation)
    except InputError as error:
        name = stamped.child_frame_id[:SHOWN_LENGTH]
        return RefusedPose(error.reason, f"transform of {name!r}: {error}")
    return TransformSample(sample, static)


def _sample(header: Any, child: str, position: Any, rotation: Any) -> PoseSample:
    check_name("frame_id", header.frame_id)
    check_name("child_frame_id", child)
    pose = transform(
        (position.x, position.y, position.z), (rotation.x, rotation.y, rotation.z, rotation.w)
    )
    return PoseSample(read_stamp(header.stamp), header.frame_id, child, pose)


def write_odometry(sample: PoseSample, types: Any) -> bytes:
    """A serialized nav_msgs/Odometry; types: rosbags' store of types."""
    t = types.types
    zeros = np.zeros(36)
    origin = t["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
    twist = t["geometry_msgs/msg/Twist"](origin, origin)
    msg = t[ODOMETRY.type](
        _header(sample, types),
        sample.child_frame_id,
        t["geometry_msgs/msg/PoseWithCovariance"](_pose(sample.pose, types), zeros),
        t["geometry_msgs/msg/TwistWithCovariance"](twist, zeros),
    )
    return bytes(types.serialize_cdr(msg, ODOMETRY.type))


def write_transform(sample: PoseSample, types: Any) -> bytes:
    """A serialized tf2_msgs/TFMessage of one transform."""
    t = types.types
    stamped = t["geometry_msgs/msg/TransformStamped"](
        _header(sample, types),
        sample.child_frame_id,
        t["geometry_msgs/msg/Transform"](
            t["geometry_msgs/msg/Vector3"](*sample.pose.position.tolist()),
            t["geometry_msgs/msg/Quaternion"](*sample.pose.rotation.tolist()),
        ),
    )
    return bytes(types.serialize_cdr(t[TF_MESSAGE]([stamped]), TF_MESSAGE))


def _header(sample: PoseSample, types: Any) -> Any:
    stamp = types.types["builtin_interfaces/msg/Time"](*divmod(sample.time_ns, SECOND))
    return types.types["std_msgs/msg/Header"](stamp, sample.frame_id)


def _pose(pose: Transform, types: Any) -> Any:
    t = types.types
    return t["geometry_msgs/msg/Pose"](
        t["geometry_msgs/msg/Point"](*pose.position.tolist()),
        t["geometry_msgs/msg/Quaternion"](*pose.rotation.tolist()),
    )
