from types import SimpleNamespace

import numpy as np
import pytest

from ellipseg_ros.errors import InputError
from ellipseg_ros.io.bag import node_types
from ellipseg_ros.io.pose_messages import (
    read_odometry,
    read_transforms,
    write_odometry,
    write_transform,
)
from ellipseg_ros.io.topics import ODOMETRY, TF_MESSAGE
from ellipseg_ros.poses.placer import RefusedPose, TransformSample
from ellipseg_ros.poses.series import PoseSample
from ellipseg_ros.poses.transforms import transform

NAN = float("nan")


def a_sample(rng):
    turn = rng.normal(size=4)
    pose = transform(rng.normal(scale=1e6, size=3), turn / np.linalg.norm(turn))
    return PoseSample(1_700_000_000_123_456_789, "odom", "base", pose)


def same(found, expected):
    assert found[:3] == expected[:3]
    np.testing.assert_array_equal(found.pose.position, expected.pose.position)
    np.testing.assert_array_equal(found.pose.rotation, expected.pose.rotation)
    return True


@pytest.mark.parametrize("seed", range(20))
def test_poses_are_written_and_read_without_a_change(seed):
    sample, types = a_sample(np.random.default_rng(seed)), node_types()
    odometry = types.deserialize_cdr(write_odometry(sample, types), ODOMETRY.type)
    assert same(read_odometry(odometry), sample)
    message = types.deserialize_cdr(write_transform(sample, types), TF_MESSAGE)
    for static in (False, True):
        (found,) = read_transforms(message, static)
        assert found.static == static and same(found.sample, sample)


def header():
    return SimpleNamespace(stamp=SimpleNamespace(sec=5, nanosec=7), frame_id="map")


def a_pose(position=(1.0, 2.0, 3.0), rotation=(0.0, 0.0, 0.0, 1.0)):
    return SimpleNamespace(
        position=SimpleNamespace(**dict(zip("xyz", position, strict=True))),
        orientation=SimpleNamespace(**dict(zip("xyzw", rotation, strict=True))),
    )


def odometry(child="base", **pose):
    with_covariance = SimpleNamespace(pose=a_pose(**pose))
    return SimpleNamespace(header=header(), child_frame_id=child, pose=with_covariance)


def test_stamped_poses_are_those_of_the_sensor():
    plain = SimpleNamespace(header=header(), pose=a_pose())
    with_covariance = SimpleNamespace(header=header(), pose=SimpleNamespace(pose=a_pose()))
    for msg in (plain, with_covariance):
        found = read_odometry(msg)
        assert found[:3] == (5 * 10**9 + 7, "map", "")
        np.testing.assert_array_equal(found.pose.position, [1.0, 2.0, 3.0])


@pytest.mark.parametrize(
    ("msg", "reason"),
    [
        (odometry(child=""), "odometry_frame"),
        (odometry(child="two\nlines"), "name"),
        (odometry(rotation=(0.0, 0.0, 0.0, 0.0)), "quaternion"),
        (odometry(rotation=(0.0, 0.0, 0.0, 1.1)), "quaternion"),
        (odometry(rotation=(0.0, 0.0, NAN, 1.0)), "pose_numbers"),
        (odometry(position=(0.0, NAN, 0.0)), "pose_numbers"),
        (odometry(position=(0.0, 0.0, 1e9)), "pose_numbers"),
    ],
)
def test_invalid_pose_is_refused_in_one_line(msg, reason):
    with pytest.raises(InputError) as error:
        read_odometry(msg)
    assert error.value.reason == reason and len(str(error.value).splitlines()) == 1


def test_quaternion_is_normalized():
    found = read_odometry(odometry(rotation=(0.0, 0.0, 0.0, 1.0 + 1e-4)))
    np.testing.assert_array_equal(found.pose.rotation, [0.0, 0.0, 0.0, 1.0])


def test_invalid_transform_leaves_the_others_of_its_message():
    def stamped(child, w):
        rotation = SimpleNamespace(x=0.0, y=0.0, z=0.0, w=w)
        moved = SimpleNamespace(translation=a_pose().position, rotation=rotation)
        return SimpleNamespace(header=header(), child_frame_id=child, transform=moved)

    message = SimpleNamespace(transforms=[stamped("arm", 0.0), stamped("lidar", 1.0)])
    refused, taken = read_transforms(message, static=False)
    assert isinstance(refused, RefusedPose) and refused.reason == "quaternion"
    assert "'arm'" in refused.text and len(refused.text.splitlines()) == 1
    assert isinstance(taken, TransformSample) and taken.sample.child_frame_id == "lidar"
