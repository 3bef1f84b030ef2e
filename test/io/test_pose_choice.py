import numpy as np
import pytest

from ellipseg_ros.config import PlacementConfig
from ellipseg_ros.errors import InputError
from ellipseg_ros.io.raw_bag import write_raw_bag
from ellipseg_ros.io.sources import as_odometry, open_source
from ellipseg_ros.poses.placer import TransformSample
from ellipseg_ros.poses.series import PoseSample
from ellipseg_ros.poses.transforms import IDENTITY, Transform, transform
from ellipseg_ros.records import Sweep

NS = 10**9


def a_bag(path, odometry=True, tf=False):
    moved = transform([1.0, 2.0, 3.0], [0.0, 0.0, 0.0, 1.0])
    events = []
    for k in range(3):
        sample = PoseSample((k + 1) * NS, "odom", "velodyne", moved)
        events += [sample] if odometry else []
        events += [TransformSample(sample._replace(child_frame_id="base"), False)] if tf else []
        events += [Sweep((k + 1) * NS, np.ones((4, 3)), frame_id="velodyne")]
    if tf:
        events.insert(0, TransformSample(PoseSample(0, "base", "velodyne", IDENTITY), True))
    write_raw_bag(path, events)
    return path


@pytest.mark.parametrize(("tf", "about"), [(False, "/odometry"), (True, "tf, in frame odom")])
def test_the_only_poses_of_a_bag_are_taken(tmp_path, tf, about):
    source = open_source(a_bag(tmp_path / "bag", odometry=not tf, tf=tf))
    assert about in source.about_poses and source.frame_id == "odom"
    assert source.duration == pytest.approx(2.0, abs=1e-6)
    for sweep in source:
        np.testing.assert_array_equal(sweep.points, np.ones((4, 3)) + [1.0, 2.0, 3.0])
    assert len(list(source)) == 3 and not source.problems


def test_raw_clouds_without_poses_are_refused_with_the_choices(tmp_path):
    bag = a_bag(tmp_path / "bag", odometry=False)
    for odometry in ("", "/odom"):
        with pytest.raises(InputError, match="--odometry") as error:
            open_source(bag, odometry=odometry)
        text = str(error.value)
        assert len(text.splitlines()) == 1 and "none" in text and "kiss-icp" in text
    assert len(list(open_source(bag, odometry="registered"))) == 3


@pytest.mark.parametrize("stamp", ["exact", "scan_begin"])
def test_tf_converted_to_an_odometry_places_the_same_points(tmp_path, stamp):
    """One pose a scan, stamped with the begin of the cloud: what it means applies to tf too."""
    events = []
    for k in range(5):
        stamp_ns = NS + k * NS // 10
        fields = np.zeros(50, [("x", "f4"), ("y", "f4"), ("z", "f4"), ("t", "u4")])
        fields["t"], fields["x"] = np.linspace(0, 99_000_000, 50), 5.0
        xyz = np.column_stack([fields[axis] for axis in "xyz"]).astype(float)
        events.append(Sweep(stamp_ns, xyz, fields["t"].astype(np.int64), fields, "lidar"))
        pose = Transform(np.array([float(k), 0.0, 0.0]), np.array([0.0, 0.0, 0.0, 1.0]))
        sample = PoseSample(stamp_ns, "odom", "lidar", pose)
        events.append(TransformSample(sample, static=False))
    write_raw_bag(tmp_path / "bag", events)
    source = open_source(tmp_path / "bag", "", "/tf", PlacementConfig(odometry_stamp=stamp))
    direct, converted = list(source), list(as_odometry(source))
    assert len(direct) == 4
    first = 5.01 if stamp == "scan_begin" else 5.0
    assert np.allclose(direct[0].points[[0, -1], 0], [first, first + 0.99])
    for one, other in zip(direct, converted, strict=True):
        assert np.array_equal(one.points, other.points)


def test_single_cloud_needs_no_pose(tmp_path):
    write_raw_bag(tmp_path / "bag", [Sweep(NS, np.ones((4, 3)), frame_id="velodyne")])
    source = open_source(tmp_path / "bag")
    assert source.frame_id == "velodyne" and len(list(source)) == 1
