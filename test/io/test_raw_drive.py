import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ellipseg_ros.config import PlacementConfig
from ellipseg_ros.errors import InputError
from ellipseg_ros.io.raw_bag import write_raw_bag
from ellipseg_ros.io.raw_drive import RawDrive, is_raw_drive
from ellipseg_ros.io.sources import open_source

COUNTS = np.array([40, 0, 25, 60])
EVERYTHING = PlacementConfig(min_range=0.0)


def poses(count, rng):
    """(count, 4, 4): a slow drive."""
    matrices = np.tile(np.eye(4), (count, 1, 1))
    turns = np.cumsum(rng.normal(scale=0.01, size=(count, 3)), axis=0)
    matrices[:, :3, :3] = Rotation.from_rotvec(turns).as_matrix()
    matrices[:, :3, 3] = np.cumsum(rng.normal(scale=0.3, size=(count, 3)), axis=0) + 1e5
    return matrices


def a_drive(path, **other):
    rng = np.random.default_rng(0)
    count = int(COUNTS.sum())
    arrays = {
        "xyz_3mm": rng.integers(-30_000, 30_000, (count, 3)).astype(np.int16),
        "count": COUNTS,
        "t": 5.0 + 0.1 * np.arange(4),
        "poses": poses(4, rng),
        "intensity": rng.integers(0, 255, count).astype(np.uint8),
        "about": np.array(7),
    } | other
    np.savez(path, **{name: array for name, array in arrays.items() if array is not None})
    return path


def test_scaled_drive_is_cut_into_sweeps_with_their_fields(tmp_path):
    path = a_drive(tmp_path / "drive.npz")
    assert is_raw_drive(path)
    drive = RawDrive(path)
    assert (drive.count, drive.frame_id, drive.duration) == (4, "lidar", pytest.approx(0.3))
    whole = np.load(path)
    found = list(drive)
    assert [len(sweep) for sweep in found] == COUNTS.tolist()
    assert [s.stamp_ns for s in found] == [5_000_000_000 + k * 10**8 for k in range(4)]
    points = np.concatenate([sweep.points for sweep in found])
    np.testing.assert_array_equal(points, whole["xyz_3mm"] * np.float64(0.003))
    intensity = np.concatenate([sweep.fields["intensity"] for sweep in found])
    np.testing.assert_array_equal(intensity, whole["intensity"])


def test_points_are_sorted_by_their_sweep(tmp_path):
    rng = np.random.default_rng(1)
    xyz = rng.normal(size=(90, 3)).astype(np.float32)
    frame = rng.integers(0, 4, 90)
    ring = np.arange(90)
    path = tmp_path / "drive.npz"
    a_drive(path, xyz_3mm=None, count=None, intensity=None, xyz=xyz, frame=frame, ring=ring)
    for number, sweep in enumerate(RawDrive(path)):
        np.testing.assert_array_equal(sweep.points, xyz[frame == number])
        np.testing.assert_array_equal(sweep.fields["ring"], ring[frame == number])


def placed_by_matrices(path):
    """The points of every sweep in the world frame, by plain products."""
    sweeps = RawDrive(path)
    for sweep, matrix in zip(sweeps, np.load(path)["poses"], strict=True):
        yield sweep.points @ matrix[:3, :3].T + matrix[:3, 3]


def test_sweeps_are_placed_by_the_pose_of_their_time(tmp_path):
    path = a_drive(tmp_path / "drive.npz")
    source = open_source(path, placement=EVERYTHING)
    assert (source.frame_id, source.count) == ("odom", 4) and source.about_poses
    found = list(source)
    assert not source.problems and len(found) == 4
    for sweep, expected in zip(found, placed_by_matrices(path), strict=True):
        assert sweep.frame_id == "odom"
        np.testing.assert_allclose(sweep.points, expected, rtol=0, atol=1e-9)


def test_settings_for_an_odometry_do_not_apply_to_poses_of_the_sensor(tmp_path):
    path = a_drive(tmp_path / "drive.npz")
    config = PlacementConfig(
        min_range=0.0, odometry_offset=0.05, odometry_stamp="scan_begin", extrinsic="1 0 0 0 0 0 1"
    )
    for sweep, expected in zip(
        open_source(path, placement=config), placed_by_matrices(path), strict=True
    ):
        np.testing.assert_allclose(sweep.points, expected, rtol=0, atol=1e-9)


def test_raw_bag_of_a_drive_gives_the_same_points(tmp_path):
    path = a_drive(tmp_path / "drive.npz")
    events = open_source(path).events
    write_raw_bag(tmp_path / "bag", events)
    equal(open_source(path), open_source(tmp_path / "bag"))


def equal(source, bag):
    assert bag.frame_id == source.frame_id and bag.about_poses == "the topic /odometry"
    found, expected = list(bag), list(source)
    assert not bag.problems and len(found) == len(expected)
    for a, b in zip(found, expected, strict=True):
        assert a.stamp_ns == b.stamp_ns and a.filtered == b.filtered
        np.testing.assert_array_equal(a.points, b.points)
        np.testing.assert_array_equal(a.ranges, b.ranges)


@pytest.mark.parametrize(
    ("other", "text"),
    [
        ({"xyz_3mm": None}, "no array xyz"),
        ({"t": np.zeros(0), "poses": np.zeros((0, 4, 4))}, "no sweeps"),
        ({"xyz_3mm": np.zeros((125, 2), np.int16)}, "(125, 2)"),
        ({"count": COUNTS + 1}, "129 points"),
        ({"count": COUNTS[:3]}, "3 sweeps"),
        ({"count": None, "frame": np.full(125, 4)}, "5 sweeps"),
        ({"count": None, "frame": np.zeros(124, int)}, "(124,)"),
        ({"poses": np.zeros((4, 4, 4))}, "no rotation"),
    ],
)
def test_contradictory_drive_is_refused_in_one_line(tmp_path, other, text):
    path = a_drive(tmp_path / "drive.npz", **other)
    with pytest.raises(InputError) as error:
        RawDrive(path)
    assert text in str(error.value) and str(path) in str(error.value)
    assert len(str(error.value).splitlines()) == 1


def test_cloud_files_are_no_raw_drives(tmp_path):
    assert not is_raw_drive(a_drive(tmp_path / "a.npz", poses=None))
    assert not is_raw_drive(a_drive(tmp_path / "b.npz", count=None))
    (tmp_path / "c.npz").write_bytes(b"damaged")
    assert not is_raw_drive(tmp_path / "c.npz")


@pytest.fixture(scope="module")
def kitti(shared_data, tmp_path_factory):
    """The first 5 sweeps of a real drive."""
    path = shared_data / "kitti_0001_full.npz"
    if not path.exists():
        pytest.skip(f"needs {path}")
    with np.load(path) as file:
        counts = file["count"][:5]
        arrays = {"count": counts, "t": file["t"][:5], "poses": file["poses"][:5]}
        arrays["xyz_3mm"] = file["xyz_3mm"][: counts.sum()]
    part = tmp_path_factory.mktemp("drive") / "kitti.npz"
    np.savez(part, **arrays)
    return part


def test_real_sweeps_are_placed_as_by_matrices(kitti):
    drive = RawDrive(kitti)
    found = list(open_source(kitti, placement=EVERYTHING))
    assert len(found) == drive.count == len(drive.poses)
    for sweep, raw, pose, matrix in zip(
        found, drive, drive.poses, np.load(kitti)["poses"], strict=True
    ):
        np.testing.assert_allclose(pose.pose.matrix, matrix, rtol=0, atol=1e-6)  # as rounded
        expected = raw.points @ pose.pose.matrix[:3, :3].T + pose.pose.matrix[:3, 3]
        np.testing.assert_allclose(sweep.points, expected, rtol=0, atol=1e-9)


def test_raw_bag_of_a_real_drive_gives_the_same_points(kitti, tmp_path):
    write_raw_bag(tmp_path / "bag", open_source(kitti).events)
    equal(open_source(kitti), open_source(tmp_path / "bag"))
