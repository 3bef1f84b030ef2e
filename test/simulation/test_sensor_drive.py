"""Raw sweeps with poses: truth, fields of vendors, stamps, and placement of what a bag holds."""

import numpy as np
import pytest

from ellipseg_ros.config import PlacementConfig
from ellipseg_ros.io.bag import BagSink
from ellipseg_ros.io.raw_bag import write_message
from ellipseg_ros.io.sources import open_source
from ellipseg_ros.poses.placer import TransformSample
from ellipseg_ros.poses.point_times import point_times
from ellipseg_ros.poses.series import PoseSample
from ellipseg_ros.records import Sweep
from ellipseg_ros.simulation.drive import START_NS
from ellipseg_ros.simulation.lidar_drive import LidarDrive
from ellipseg_ros.simulation.sensor_drive import SensorDrive

EXACT = {"noise": 0.0, "drift": 0.0}


def town(duration=0.3, lidar="wide32", **settings):
    return LidarDrive("town", duration=duration, lidar=lidar, **settings)


def clouds(drive, **settings):
    return [e for _, e in SensorDrive(drive, **settings) if isinstance(e, Sweep)]


def test_points_at_their_true_poses_are_the_points_of_the_world():
    drive = town(speed=16.0, **EXACT)
    for raw, registered in zip(clouds(drive, missing="left_out"), drive, strict=True):
        assert raw.frame_id == "lidar" and registered.frame_id == "odom"
        assert np.array_equal(raw.offsets_ns, registered.offsets_ns)
        sensor = drive.sensor_poses(np.unique(raw.times_ns))
        line = np.searchsorted(np.unique(raw.times_ns), raw.times_ns)
        for k in range(0, len(raw), 997):
            placed = sensor.rotation[line[k]].apply(raw.points[k]) + sensor.position[line[k]]
            assert np.allclose(raw.fields["truth"][k], placed, atol=1e-6)
            assert np.allclose(registered.points[k], placed, atol=1e-5)  # of float32
        moved = np.linalg.norm(sensor.position[-1] - sensor.position[0])
        assert moved == pytest.approx(1.6, rel=0.05)  # a still pose would be far off


@pytest.mark.parametrize(
    ("vendor", "name", "kind", "resolution"),
    [
        ("ouster", "t", np.uint32, 0),
        ("velodyne", "time", np.float32, 4),
        ("hesai", "timestamp", np.float64, 130),
        ("livox", "offset_time", np.uint32, 0),
    ],
)
@pytest.mark.parametrize("stamp", ["begin", "end"])
def test_times_in_a_vendors_form_are_read_as_the_true_ones(vendor, name, kind, resolution, stamp):
    for raw in clouds(town(), vendor=vendor, stamp=stamp):
        assert raw.fields.dtype[name] == kind
        offsets_ns = point_times(raw.fields, raw.stamp_ns).offsets_ns
        if stamp == "end" and kind == np.uint32:  # a driver's counter begins with the sweep
            offsets_ns = offsets_ns - 100_000_000
        assert np.abs(offsets_ns - raw.offsets_ns).max() <= resolution
        begin = 0 if stamp == "begin" else -100_000_000
        assert begin <= raw.offsets_ns.min() < raw.offsets_ns.max() < begin + 100_000_000
        assert raw.fields.dtype["ring"] == np.uint16


@pytest.mark.parametrize(("missing", "value"), [("zero", 0.0), ("nan", np.nan)])
def test_beams_without_a_return_are_rows_of_zeros_or_nan(missing, value):
    (raw,) = clouds(town(0.1), missing=missing)
    (returned,) = clouds(town(0.1), missing="left_out")
    assert len(raw) == 1024 * 32 > len(returned)
    absent = np.isnan(raw.fields["truth"][:, 0])
    assert np.array_equal(raw.points[~absent], returned.points)
    assert np.array_equal(raw.points[absent], np.full((absent.sum(), 3), value), equal_nan=True)


def test_messages_come_in_the_order_of_time_and_start_with_the_extrinsic():
    drive = SensorDrive(town(), odometry_rate=30)
    times, events = zip(*drive, strict=True)
    assert (np.diff(times) >= 0).all() and times[-1] == START_NS + 300_000_000
    first = events[0]
    assert isinstance(first, TransformSample) and first.static
    assert (first.sample.frame_id, first.sample.child_frame_id) == ("base_link", "lidar")
    poses = [event for event in events if isinstance(event, PoseSample)]
    assert [p.time_ns - START_NS for p in poses] == [k * 1_000_000_000 // 30 for k in range(10)]
    assert [e.sample for e in events if isinstance(e, TransformSample)][1:] == poses


@pytest.mark.parametrize("meaning", ["scan_begin", "scan_end"])
def test_pose_of_a_sweep_is_that_of_its_end_whatever_its_stamp_is(meaning):
    drive = town(**EXACT)
    raw = SensorDrive(drive, odometry_stamp=meaning, odometry_noise=0.0)
    poses = [event for _, event in raw if isinstance(event, PoseSample)]
    ends_ns = START_NS + 100_000_000 * np.arange(1, 4)
    stamps = [pose.time_ns for pose in poses]
    assert stamps == (ends_ns - (100_000_000 if meaning == "scan_begin" else 0)).tolist()
    true = drive.poses(ends_ns)
    assert np.allclose([p.pose.position for p in poses], true.position, atol=1e-9)


@pytest.mark.parametrize(
    ("odometry", "meaning", "limit"),
    [
        ("/tf", "exact", 0.01),
        ("/odometry", "exact", 0.01),
        ("/odometry", "scan_begin", 0.04),  # the motion between two poses is not uniform
        ("/odometry", "scan_end", 0.04),
    ],
)
def test_bag_is_placed_where_the_points_truly_are(tmp_path, odometry, meaning, limit):
    path = tmp_path / "raw"
    drive = town(0.8, speed=12.0, nan_share=0.01, **EXACT)
    with BagSink(path) as bag:
        for time_ns, event in SensorDrive(drive, odometry_stamp=meaning, odometry_noise=0.0):
            write_message(bag, time_ns, event)
    frame = "odom" if odometry == "/tf" else ""
    placement = PlacementConfig(odometry_stamp=meaning, fixed_frame=frame)
    sweeps = list(open_source(path, odometry=odometry, placement=placement))
    assert len(sweeps) >= 6
    for sweep in sweeps:
        assert sweep.frame_id == "odom" and len(sweep) > 15_000
        error = np.linalg.norm(sweep.points - sweep.fields["truth"], axis=1)
        assert np.nanquantile(error, 0.99) < limit and np.nanmax(error) < 2.0 * limit
        assert np.isfinite(error).mean() > 0.97


def test_drift_and_noise_are_those_that_were_asked_for():
    noisy, exact = (
        np.array([e.pose.position for _, e in SensorDrive(town(1.0, **EXACT), odometry_noise=noise)
                  if isinstance(e, PoseSample)])
        for noise in (0.02, 0.0)
    )  # fmt: skip
    assert np.std(noisy - exact) == pytest.approx(0.02, rel=0.25)
    drive = town(1.0, drift=2.0)
    events = SensorDrive(drive, odometry_noise=0.0)
    poses = [e.pose.position for _, e in events if isinstance(e, PoseSample)]
    off = np.linalg.norm(np.array(poses) - exact, axis=1)
    assert off[0] < 1e-9 and 0.1 < off[-1] < 2.0
