import numpy as np
import pytest
from naive_poses import naive_pose
from scipy.spatial.transform import Rotation

from ellipseg_ros.config import PlacementConfig
from ellipseg_ros.errors import InputError
from ellipseg_ros.poses.interpolation import place
from ellipseg_ros.poses.series import PoseSample
from ellipseg_ros.poses.sources import Query, TransformPoses, Waiting, new_tree
from ellipseg_ros.poses.transforms import compose, inverse, transform
from ellipseg_ros.poses.tree import static_transform

NS = 10**9


def random_pose(rng, scale=1.0):
    return transform(rng.normal(scale=scale, size=3), Rotation.random(rng=rng).as_quat())


def poses_of(links, fixed="odom"):
    """TransformPoses of (parent, child, pose, time_ns; None: static)."""
    config = PlacementConfig(pose_source="tf", fixed_frame=fixed, odometry_jump=0.0)
    found = TransformPoses(config, new_tree(config))
    for parent, child, pose, time_ns in links:
        sample = PoseSample(time_ns or 0, parent, child, pose)
        found.tree.add(sample, static=time_ns is None)
    return found


def refused(tree, parent, child, reason, static=False):
    sample = PoseSample(NS, parent, child, random_pose(np.random.default_rng(0)))
    with pytest.raises(InputError) as error:
        tree.add(sample, static)
    assert error.value.reason == reason and len(str(error.value).splitlines()) == 1
    return str(error.value)


def test_transforms_are_composed_and_inverted():
    rng = np.random.default_rng(0)
    a, b = random_pose(rng), random_pose(rng)
    np.testing.assert_allclose(compose(a, b).matrix, a.matrix @ b.matrix, atol=1e-12)
    np.testing.assert_allclose(inverse(a).matrix, np.linalg.inv(a.matrix), atol=1e-12)


def test_static_path_leads_up_and_down():
    rng = np.random.default_rng(1)
    a, b, c = (random_pose(rng) for _ in range(3))
    tree = poses_of(
        [("base", "mast", a, None), ("/mast", "/lidar", b, None), ("base", "imu", c, None)]
    ).tree
    found = static_transform(tree.path("imu", "/lidar"))
    expected = np.linalg.inv(c.matrix) @ a.matrix @ b.matrix
    np.testing.assert_allclose(found.matrix, expected, atol=1e-12)
    assert tree.path("lidar", "lidar") == [] and tree.path("lidar", "moon") is None
    assert tree.root("lidar") == "base" and tree.frames_above("lidar") == ["lidar", "mast", "base"]


def moving(parent, child, rng, count=12):
    """A link with samples at random times from 0 to 3 s."""
    times = np.sort(rng.choice(30, count, replace=False)) * (NS // 10) + rng.integers(NS // 10)
    times = np.concatenate([[0], times, [3 * NS + NS // 2]])
    return [(parent, child, random_pose(rng, 5.0), int(t) or 1) for t in times]


def table(links):
    """The samples of one link as poses for naive_pose."""
    poses = np.zeros(len(links), [("time_ns", "i8"), ("position", "f8", 3), ("rotation", "f8", 4)])
    for row, (_, _, pose, time_ns) in zip(poses, links, strict=True):
        row["time_ns"], row["position"], row["rotation"] = time_ns, *pose
    return poses


def matrix_at(links, time_ns):
    position, rotation = naive_pose(table(links), time_ns)
    return transform(position, rotation.as_quat()).matrix


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("inverted", [False, True])
def test_two_moving_links_are_interpolated_each_and_composed(seed, inverted):
    """map -> odom -> base -> lidar; inverted: an odometry that publishes base -> odom."""
    rng = np.random.default_rng(seed)
    first = moving("map", "odom", rng)
    second = moving("odom", "base", rng)
    if inverted:  # odom is the root: map and base are below it
        first = moving("odom", "map", rng)
    mount = random_pose(rng)
    links = [*first, ("base", "lidar", mount, None), *second]
    found = poses_of(links, "map")
    track = found.track(Query("lidar", 0, NS, 2 * NS))
    assert not track.registered and track.frame_id == "map"
    times = track.poses["time_ns"]
    assert times[0] <= NS and times[-1] >= 2 * NS
    assert set(times) <= {link[3] for link in links}
    points = rng.normal(size=(len(times), 3))
    placed = place(points, times, track.poses, track.extrinsic)
    for point, time_ns, result in zip(points, times, placed, strict=True):
        upper, lower = matrix_at(first, time_ns), matrix_at(second, time_ns)
        upper = np.linalg.inv(upper) if inverted else upper
        expected = upper @ lower @ mount.matrix @ [*point, 1.0]
        np.testing.assert_allclose(result, expected[:3], rtol=0, atol=1e-9)


def test_lidar_may_be_the_parent_of_the_odometry():
    rng = np.random.default_rng(7)
    pose = random_pose(rng)
    links = [("lidar", "odom", pose, t * NS) for t in (1, 2)]
    track = poses_of(links).track(Query("lidar", 0, NS, NS))
    placed = place(np.ones((1, 3)), np.array([NS]), track.poses, track.extrinsic)
    expected = np.linalg.inv(pose.matrix) @ np.ones(4)
    np.testing.assert_allclose(placed[0], expected[:3], atol=1e-12)


def test_static_sensor_and_registered_clouds():
    pose = random_pose(np.random.default_rng(8))
    found = poses_of([("odom", "lidar", pose, None)])
    track = found.track(Query("lidar", 0, NS, 2 * NS))
    placed = place(np.ones((1, 3)), np.array([NS]), track.poses, track.extrinsic)
    np.testing.assert_allclose(placed[0], (pose.matrix @ np.ones(4))[:3], atol=1e-12)
    assert found.track(Query("/odom", 0, NS, NS)).registered


def test_missing_and_late_links_are_waited_for():
    found = poses_of([("base", "lidar", random_pose(np.random.default_rng(9)), None)])
    waiting = found.track(Query("lidar", 0, NS, NS))
    assert isinstance(waiting, Waiting) and waiting.reason == "no_transform"
    assert "'lidar' to 'odom'" in waiting.text and "lidar, base" in waiting.text
    found.tree.add(PoseSample(NS, "odom", "base", random_pose(np.random.default_rng(1))), False)
    late = found.track(Query("lidar", 0, NS, 2 * NS))
    assert isinstance(late, Waiting) and late.reason == "late_poses" and "1.000 s" in late.text


def test_contradictions_are_refused_and_change_nothing():
    rng = np.random.default_rng(10)
    tree = poses_of(
        [("odom", "base", random_pose(rng), NS), ("base", "l", random_pose(rng), None)]
    )
    tree = tree.tree
    assert "two parents" in refused(tree, "map", "base", "tf_parents")
    assert "cycle" in refused(tree, "l", "odom", "tf_cycle")
    assert "cycle" in refused(tree, "x", "/x", "tf_cycle")
    assert "empty frame" in refused(tree, "", "x", "tf_frame")
    assert "empty frame" in refused(tree, "x", "", "tf_frame")
    assert "static" in refused(tree, "base", "l", "tf_static")
    assert "static" in refused(tree, "odom", "base", "tf_static", static=True)
    assert tree.frames_above("l") == ["l", "base", "odom"]
