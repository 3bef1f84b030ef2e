"""Raw clouds and poses in bags of every format, as other programs write them."""

import sqlite3

import numpy as np
import pytest
from raw_bags import (
    FORMATS,
    LIVOX,
    LIVOX_1,
    LIVOX_POINT,
    NS,
    POSE,
    POSE_WITH_COVARIANCE,
    START_NS,
    RawBag,
    sensor,
    truth,
    vehicle,
    write_drive,
)

from ellipseg_ros.config import PlacementConfig
from ellipseg_ros.errors import InputError
from ellipseg_ros.io.bag import BagSweeps
from ellipseg_ros.io.pose_choice import choose_poses
from ellipseg_ros.io.sources import open_source

EVERYTHING = PlacementConfig(min_range=0.0)


def path_of(folder, kind):
    return folder / ("drive.bag" if kind.startswith("ros1") else "drive")


def refused(call, reason):
    with pytest.raises(InputError) as error:
        call()
    assert error.value.reason == reason and len(str(error.value).splitlines()) == 1
    return str(error.value)


# --- poses -----------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize(
    ("poses", "about"),
    [
        ("odometry", "the topic /odometry"),
        (POSE, "the topic /pose"),
        (POSE_WITH_COVARIANCE, "the topic /pose"),
        ("tf", "tf, in frame odom"),
    ],
)
def test_clouds_are_placed_by_the_poses_of_the_bag(tmp_path, kind, poses, about):
    check_drive(write_drive(path_of(tmp_path, kind), poses, kind), about)


def check_drive(path, about):
    source = open_source(path, placement=EVERYTHING)
    assert (source.about_poses, source.frame_id, source.count) == (about, "odom", 4)
    found, expected = list(source), list(truth())
    assert not source.problems and len(found) == len(expected) == 4
    for sweep, points in zip(found, expected, strict=True):
        assert sweep.frame_id == "odom" and sweep.unplaced == 0
        np.testing.assert_allclose(sweep.points, points, rtol=0, atol=1e-9)


def test_transforms_of_the_old_tf_are_read(tmp_path):
    path = write_drive(tmp_path / "drive.bag", "old tf", "ros1")
    check_drive(path, "tf, in frame odom")


def several_topics(path, children):
    with RawBag(path) as bag:
        for seconds in (0.0, 0.1, 0.2):
            stamp_ns = START_NS + round(seconds * NS)
            for topic, child in children.items():
                bag.odometry(stamp_ns, vehicle(seconds), topic, child)
            bag.cloud(stamp_ns, np.ones((3, 3), np.float32))
    return BagSweeps(path)


def test_several_topics_with_poses_are_listed_in_one_line(tmp_path):
    clouds = several_topics(tmp_path / "bag", {"/wheels": "base", "/gnss": "antenna"})
    text = refused(lambda: choose_poses(clouds, "", EVERYTHING), "no_odometry")
    assert "/gnss, /wheels" in text and "--odometry" in text
    text = refused(lambda: choose_poses(clouds, "/slam", EVERYTHING), "no_odometry")
    assert "no poses on /slam" in text and "/gnss, /wheels" in text
    assert choose_poses(clouds, "wheels", EVERYTHING).about == "the topic /wheels"


def test_poses_of_the_sensor_itself_come_first(tmp_path):
    children = {"/wheels": "base", "/slam": "lidar", "/gnss": "antenna"}
    poses = choose_poses(several_topics(tmp_path / "bag", children), "", EVERYTHING)
    assert poses.about == "the topic /slam" and poses.placement.pose_source == "odometry"


def test_only_topic_with_poses_is_taken_and_none_is_refused(tmp_path):
    poses = choose_poses(several_topics(tmp_path / "one", {"/wheels": "base"}), "", EVERYTHING)
    assert poses.about == "the topic /wheels"
    clouds = several_topics(tmp_path / "none", {})
    text = refused(lambda: choose_poses(clouds, "", EVERYTHING), "no_odometry")
    assert "topics with poses: none" in text and "registered" in text


# --- Livox -----------------------------------------------------------------------------------

LAYOUT = {
    LIVOX: "std_msgs/Header header\nuint64 timebase\nuint32 point_num\nuint8 lidar_id\n"
    "uint8[3] rsvd\nCustomPoint[] points\n"
}
LAYOUT[LIVOX_1] = LAYOUT[LIVOX]


def livox_points(rng, count=50):
    names = [("offset_time", "u4"), *((n, "f4") for n in "xyz")]
    names += [(n, "u1") for n in ("reflectivity", "tag", "line")]
    points = np.zeros(count, names)
    points["offset_time"] = np.sort(rng.integers(0, NS // 10, count))
    points["offset_time"][0] = 0
    for name in "xyz":
        points[name] = rng.normal(scale=20.0, size=count)
    for name in ("reflectivity", "tag", "line"):
        points[name] = rng.integers(0, 256, count)
    return points


def write_livox(path, kind, name=LIVOX, point=LIVOX_POINT, sweeps=2):
    """A bag of CustomMsg with an odometry of the lidar; returns the points of every sweep."""
    written = []
    with RawBag(path, kind) as bag:
        part = name.replace("CustomMsg", "CustomPoint")
        bag.define(part, point)
        bag.define(name, LAYOUT[name])
        order = [line.split()[1] for line in point.splitlines()]
        for k in range(sweeps):
            points = livox_points(np.random.default_rng(k))
            stamp_ns = START_NS + k * NS // 10
            parts = [bag.make(part, *(row[n].item() for n in order)) for row in points]
            header = bag.header(stamp_ns, "livox_frame")
            values = (header, stamp_ns, len(parts), 0, np.zeros(3, np.uint8), parts)
            for later in (0.0, 0.05, 0.1):
                at = k * 0.1 + later
                if later or not k:
                    at_ns = START_NS + round(at * NS)
                    bag.odometry(at_ns, sensor(at), child="livox_frame")
            bag.write("/livox/lidar", name, stamp_ns, bag.make(name, *values))
            written.append(points)
    return written


def check_livox(path, written):
    sweeps = list(BagSweeps(path))
    assert len(sweeps) == len(written)
    for k, (sweep, points) in enumerate(zip(sweeps, written, strict=True)):
        assert (sweep.stamp_ns, sweep.frame_id) == (START_NS + k * NS // 10, "livox_frame")
        np.testing.assert_array_equal(sweep.offsets_ns, points["offset_time"])
        for column, name in enumerate("xyz"):
            np.testing.assert_array_equal(sweep.points[:, column], points[name])
        for name in points.dtype.names:
            np.testing.assert_array_equal(sweep.fields[name], points[name])


@pytest.mark.parametrize(
    ("kind", "name"),
    [("mcap", LIVOX), ("mcap", LIVOX_1), ("sqlite3", LIVOX), ("ros1", LIVOX_1), ("ros1", LIVOX)],
)
def test_custom_clouds_of_livox_are_read_with_all_fields(tmp_path, kind, name):
    path = path_of(tmp_path, kind)
    check_livox(path, write_livox(path, kind, name))


def test_custom_clouds_of_livox_are_placed_at_the_time_of_each_point(tmp_path):
    written = write_livox(tmp_path / "drive", "mcap")
    found = list(open_source(tmp_path / "drive", placement=EVERYTHING))
    assert len(found) == 2
    for k, (sweep, points) in enumerate(zip(found, written, strict=True)):
        for row in (0, 17, 49):
            # The curve between two poses 0.05 s apart is less than 1 cm from a straight line.
            matrix = sensor(0.1 * k + points["offset_time"][row] / NS).matrix
            expected = matrix @ [*(points[row][n] for n in "xyz"), 1.0]
            np.testing.assert_allclose(sweep.points[row], expected[:3], rtol=0, atol=0.01)


def test_bag_without_the_definition_is_refused_in_one_line(tmp_path):
    path = tmp_path / "drive"
    write_livox(path, "sqlite3")
    (storage,) = path.glob("*.db3")
    with sqlite3.connect(storage) as database:
        database.execute("DELETE FROM message_definitions")
    text = refused(lambda: BagSweeps(path), "no_definition")
    assert LIVOX in text and "mcap" in text


def test_definition_of_one_bag_is_not_used_for_another(tmp_path):
    other = "float32 x\nfloat32 y\nfloat32 z\nuint8 line\nuint8 tag\nuint8 reflectivity\n"
    other += "uint32 offset_time\n"
    for number, point in enumerate((LIVOX_POINT, other, LIVOX_POINT)):
        path = tmp_path / str(number)
        check_livox(path, write_livox(path, "mcap", point=point))
