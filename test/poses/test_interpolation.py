import numpy as np
import pytest
from naive_poses import naive_pose
from scipy.spatial.transform import Rotation

from ellipseg_ros.poses.filters import filtered
from ellipseg_ros.poses.interpolation import interpolated, place
from ellipseg_ros.poses.series import POSE
from ellipseg_ros.poses.transforms import IDENTITY, transform

pytestmark = pytest.mark.nojit

NS = 10**9


def series(count, rng, spread=10.0, start_ns=1_700_000_000 * NS):
    """(count,) of POSE at uneven times, with large rotations between them, either sign."""
    poses = np.zeros(count, POSE)
    poses["time_ns"] = start_ns + np.cumsum(rng.integers(1, NS // 10, count))
    poses["position"] = rng.normal(scale=spread, size=(count, 3))
    poses["rotation"] = Rotation.random(count, rng=rng).as_quat()
    poses["rotation"] *= rng.choice([-1.0, 1.0], (count, 1))
    poses["run"] = 3
    return poses


def naive_place(points, times_ns, poses, extrinsic):
    placed = np.empty_like(points)
    for i, point in enumerate(points):
        position, rotation = naive_pose(poses, times_ns[i])
        placed[i] = position + rotation.as_matrix() @ (extrinsic.matrix @ [*point, 1.0])[:3]
    return placed


def same_rotation(a, b):
    """Whether unit quaternions (m, 4) are those of the same rotations; q and -q are."""
    np.testing.assert_allclose(np.abs(np.sum(a * b, axis=-1)), 1.0, rtol=0, atol=1e-14)
    return True


@pytest.mark.parametrize("cut", [slice(None), slice(2, 6), slice(3, 4)])
def test_pose_at_the_time_of_a_sample_is_the_sample_bit_for_bit(cut):
    """Also at the end of a stretch: the bits must not depend on what follows."""
    poses = series(9, np.random.default_rng(6))[cut]
    np.testing.assert_array_equal(interpolated(poses, poses["time_ns"]), poses)


@pytest.mark.parametrize("seed", range(5))
def test_poses_between_samples_equal_those_of_scipy(seed):
    rng = np.random.default_rng(seed)
    poses = series(7, rng)
    begin, end = poses["time_ns"][[0, -1]]
    times = rng.integers(begin, end, 50)  # in any order
    found = interpolated(poses, times)
    np.testing.assert_array_equal(found["time_ns"], times)
    assert (found["run"] == 3).all()
    for row, time_ns in zip(found, times, strict=True):
        position, rotation = naive_pose(poses, time_ns)
        np.testing.assert_allclose(row["position"], position, rtol=0, atol=1e-12)
        assert same_rotation(row["rotation"], rotation.as_quat())


@pytest.mark.parametrize("count", [1, 2, 6])
def test_poses_at_the_samples_are_the_samples(count):
    poses = series(count, np.random.default_rng(count))
    found = interpolated(poses, poses["time_ns"])
    np.testing.assert_allclose(found["position"], poses["position"], rtol=0, atol=1e-14)
    assert same_rotation(found["rotation"], poses["rotation"])


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-7, 1e-4, 3.0, np.pi])
def test_small_and_large_turns_are_halved(angle):
    poses = np.zeros(2, POSE)
    poses["time_ns"] = 0, 100
    poses["rotation"] = Rotation.from_rotvec([[0.0, 0.0, 0.0], [0.0, angle, 0.0]]).as_quat()
    found = interpolated(poses, np.array([50]))["rotation"][0]
    half = Rotation.from_rotvec([0.0, angle / 2, 0.0]).as_quat()
    np.testing.assert_allclose(np.abs(found), np.abs(half), rtol=0, atol=1e-15)


def test_negated_quaternions_are_the_same_poses():
    rng = np.random.default_rng(2)
    poses = series(5, rng)
    negated = poses.copy()
    negated["rotation"][::2] *= -1.0
    points = rng.normal(size=(40, 3))
    times = rng.integers(*poses["time_ns"][[0, -1]], 40)
    np.testing.assert_allclose(
        place(points, times, poses, IDENTITY),
        place(points, times, negated, IDENTITY),
        rtol=0,
        atol=1e-13,
    )


@pytest.mark.parametrize(("count", "ordered"), [(1, True), (2, True), (6, True), (6, False)])
def test_points_are_placed_as_one_by_one(count, ordered):
    rng = np.random.default_rng(count)
    poses = series(count, rng)
    extrinsic = transform([0.5, -0.2, 1.8], Rotation.from_rotvec([0.1, 0.2, 3.0]).as_quat())
    points = rng.normal(scale=30.0, size=(200, 3))
    times = rng.integers(poses["time_ns"][0], poses["time_ns"][-1] + 1, 200)
    times[::10] = rng.choice(poses["time_ns"], 20)
    if ordered:
        times.sort()
    points[7], points[20, 1], points[21, 0] = np.nan, np.nan, np.nan
    found = place(points, times, poses, extrinsic)
    expected = naive_place(points, times, poses, extrinsic)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
    assert np.isnan(found).all(axis=1).nonzero()[0].tolist() == [7, 20, 21]


def test_far_poses_lose_no_more_than_rounding():
    rng = np.random.default_rng(4)
    poses = series(3, rng)
    points = rng.normal(scale=50.0, size=(100, 3))
    times = rng.integers(*poses["time_ns"][[0, -1]], 100)
    near = place(points, times, poses, IDENTITY)
    poses["position"] += 1e6
    far = place(points, times, poses, IDENTITY)
    np.testing.assert_allclose(far - 1e6, near, rtol=0, atol=1e-9)


def test_no_points_are_placed_to_none():
    poses = series(2, np.random.default_rng(0))
    assert place(np.zeros((0, 3)), np.zeros(0, np.int64), poses, IDENTITY).shape == (0, 3)


def naive_kept(point, limits, box):
    """Whether a point passes the filters."""
    distance = np.linalg.norm(point)
    if not np.isfinite(distance):
        return True
    in_box = all(box[0][k] <= point[k] <= box[1][k] for k in range(3))
    return limits[0] <= distance <= limits[1] and not in_box


@pytest.mark.parametrize("limits", [(0.0, np.inf), (0.1, np.inf), (1.0, 2.0)])
@pytest.mark.parametrize("box", [((-1, -0.5, -9), (1, 0.5, 9)), ((np.inf,) * 3, (-np.inf,) * 3)])
def test_filters_equal_those_of_one_point(limits, box):
    rng = np.random.default_rng(5)
    points = rng.normal(size=(300, 3))
    points[:5] = 0.0
    points[5:9, 0] = np.nan, np.inf, -np.inf, 1e200
    points[9] = [1.0, 0.5, 9.0]  # a corner of the box
    with np.errstate(over="ignore"):
        ranges, keep = filtered(points, limits, np.array(box, float))
        expected = [naive_kept(point, limits, box) for point in points]
        np.testing.assert_array_equal(keep, expected)
        distances = np.sqrt(np.sum(points * points, axis=1))
    np.testing.assert_allclose(ranges, distances, rtol=1e-15)
