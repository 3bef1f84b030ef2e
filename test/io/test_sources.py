from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ellipseg_ros.config import PlacementConfig
from ellipseg_ros.errors import ConfigError, InputError
from ellipseg_ros.io.bag import BagSink
from ellipseg_ros.io.sources import Source, as_odometry, open_source
from ellipseg_ros.poses.placer import TransformSample
from ellipseg_ros.poses.series import PoseSample
from ellipseg_ros.poses.transforms import transform
from ellipseg_ros.records import Sweep
from ellipseg_ros.simulation.simulator import SCENES


def a_bag(path):
    with BagSink(path) as sink:
        for k in range(3):
            points = np.random.default_rng(k).normal(size=(9, 3))
            sink.write_event(Sweep(k * 10**8, points, np.arange(9), frame_id="map"))
    return path


def a_cloud(path):
    np.savez(path, xyz=np.zeros((9, 3)), t=np.linspace(0.0, 0.29, 9))
    return path


SIMULATED = {"duration": 0.3, "seed": 4}


@pytest.fixture(params=["bag", "file of a bag", "cloud", "scene"])
def source(request, tmp_path):
    """The same length of everything that can be opened."""
    if request.param == "scene":
        return open_source("sim:woodland", **SIMULATED)
    if request.param == "cloud":
        return open_source(a_cloud(tmp_path / "drive.npz"))
    bag = a_bag(tmp_path / "drive")
    return open_source(str(bag / "drive.mcap") if "file" in request.param else bag)


def test_source_describes_itself_and_can_be_iterated_repeatedly(source):
    assert source.name in ("drive", "woodland") and source.frame_id in ("map", "odom")
    assert source.count == 3 and source.duration == pytest.approx(0.25, abs=0.06)
    first, second = list(source), list(source)
    assert len(first) == len(second) == 3
    for a, b in zip(first, second, strict=True):
        assert a.frame_id == source.frame_id
        np.testing.assert_array_equal(a.points, b.points)
        np.testing.assert_array_equal(a.times_ns, b.times_ns)


def test_bag_written_from_a_source_equals_it(source, tmp_path):
    with BagSink(tmp_path / "copy") as sink:
        for sweep in source:
            sink.write_event(sweep)
    for a, b in zip(source, open_source(tmp_path / "copy"), strict=True):
        assert (a.stamp_ns, a.frame_id) == (b.stamp_ns, b.frame_id)
        np.testing.assert_array_equal(a.points, b.points)
        np.testing.assert_array_equal(a.offsets_ns, b.offsets_ns)


def test_topic_is_passed_to_the_bag(tmp_path):
    bag = a_bag(tmp_path / "drive")
    assert open_source(bag, "points").count == 3
    with pytest.raises(InputError, match="/points"):
        open_source(bag, "/velodyne")


@pytest.mark.parametrize("scene", SCENES)
def test_every_scene_has_points(scene):
    assert sum(map(len, open_source(f"sim:{scene}", **SIMULATED))) > 1000


def test_unreadable_source_is_refused_with_a_list_of_formats(tmp_path):
    (tmp_path / "cloud.e57").touch()
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder.ply").mkdir()
    for spec in ("missing.bag", "cloud.e57", "folder", "folder.ply"):
        with pytest.raises(InputError) as error:
            open_source(tmp_path / spec)
        text = str(error.value)
        assert spec in text and len(text.splitlines()) == 1
        assert all(kind in text for kind in (".bag", ".mcap", ".laz", "sim:", "woodland"))
    with pytest.raises(InputError, match="woodland") as error:
        open_source("sim:moon")
    assert len(str(error.value).splitlines()) == 1


def test_scene_refuses_invalid_settings():
    with pytest.raises(ConfigError, match="duration"):
        open_source("sim:woodland", duration=-1.0)


# --- poses as an odometry ------------------------------------------------------------------------

MOUNT = transform([0.5, 0.2, 1.8], Rotation.from_euler("zyx", [0.5, 0.1, -0.2]).as_quat())
NS = 10**9


def swaying(seconds, speed):
    """A pose that moves and turns smoothly."""
    turn = Rotation.from_euler("zyx", [0.4 * seconds, 0.1 * np.sin(seconds), 0.05 * seconds])
    return transform([speed * seconds, seconds**2, 0.0], turn.as_quat())


def moving_clouds(frame_id, timed, count=12):
    """Clouds every 0.1 s, whose points have times of their own, or that of the stamp."""
    rng = np.random.default_rng(3)
    for k in range(count):
        fields = np.zeros(40, [(n, "f4") for n in "xyz"] + ([("t", "u4")] if timed else []))
        for name in "xyz":
            fields[name] = rng.normal(scale=10.0, size=40)
        if timed:
            fields["t"] = np.sort(rng.integers(0, NS // 10, 40))
        points = np.column_stack([fields[name] for name in "xyz"]).astype(np.float64)
        yield Sweep(NS + k * NS // 10, points, fields=fields, frame_id=frame_id)


def source_of(events, **placement):
    clouds = sum(isinstance(event, Sweep) for event in events)
    return Source("drive", "map", clouds, None, events, PlacementConfig(**placement))


def tf_source(timed, offset):
    """map -> odom at 20 Hz, odom -> base at 50 Hz; the lidar is the base, or mounted on it."""
    frame_id = "lidar" if offset else "base"
    events = [TransformSample(PoseSample(0, "base", "lidar", MOUNT), True)]
    for k in range(28):
        at = 0.95 + 0.05 * k
        sample = PoseSample(round(at * NS), "map", "odom", swaying(at, 0.1))
        events.append(TransformSample(sample, False))
    for k in range(70):
        at = 0.94 + 0.02 * k
        sample = PoseSample(round(at * NS), "odom", "base", swaying(at, 12.0))
        events.append(TransformSample(sample, False))
    clouds = list(moving_clouds(frame_id, timed))
    return source_of([*events, *clouds], pose_source="tf", fixed_frame="map")


def odometry_source(timed, offset, **placement):
    """An odometry at 50 Hz of the base, with the lidar's static transform."""
    events = [TransformSample(PoseSample(0, "base", "lidar", MOUNT), True)]
    for k in range(70):
        at = 0.94 + 0.02 * k
        events.append(PoseSample(round(at * NS), "odom", "base", swaying(at, 12.0)))
    clouds = list(moving_clouds("lidar" if offset else "base", timed))
    return source_of([*events, *clouds], pose_source="odometry", **placement)


def differences(source):
    """Greatest distance of the points placed with the poses as an odometry, m."""
    played = as_odometry(source)
    kinds = {type(event) for event in played.events}
    assert played.placement.pose_source == "odometry" and PoseSample in kinds
    # A replayer publishes no transforms.
    events = [event for event in played.events if not isinstance(event, TransformSample)]
    direct, found = list(source), list(replace(played, events=events))
    assert len(direct) == len(found) == source.count and not source.problems
    for a, b in zip(direct, found, strict=True):
        assert (a.stamp_ns, a.frame_id, a.filtered) == (b.stamp_ns, b.frame_id, b.filtered)
        np.testing.assert_array_equal(a.offsets_ns, b.offsets_ns)
    return max(np.abs(a.points - b.points).max() for a, b in zip(direct, found, strict=True))


@pytest.mark.parametrize("timed", [False, True])
def test_tf_of_the_sensor_itself_gives_the_same_bits_as_an_odometry(timed):
    assert differences(tf_source(timed, offset=False)) == 0.0


def test_tf_of_an_offset_sensor_gives_the_same_points_at_the_times_of_transforms():
    assert differences(tf_source(timed=False, offset=True)) < 1e-6


def test_tf_of_an_offset_sensor_differs_by_the_chord_of_its_turn_between_transforms():
    # Direct poses interpolate the base; an odometry of the lidar, the chord of its arc.
    chord = np.linalg.norm(MOUNT.position) * (0.45 * 0.02) ** 2 / 8.0
    assert differences(tf_source(timed=True, offset=True)) < 1.5 * chord < 1e-4


@pytest.mark.parametrize("timed", [False, True])
@pytest.mark.parametrize("offset", [False, True])
def test_odometry_with_a_static_transform_gives_the_same_bits_with_an_extrinsic(timed, offset):
    source = odometry_source(timed, offset)
    assert differences(source) == 0.0
    assert bool(as_odometry(source).placement.extrinsic) == offset


def test_given_extrinsic_stays_and_registered_clouds_need_no_poses():
    given = odometry_source(False, True, extrinsic="1 2 3 0 0 0 1")
    assert differences(given) == 0.0
    assert as_odometry(given).placement.extrinsic == "1 2 3 0 0 0 1"
    registered = source_of(list(moving_clouds("map", False)), pose_source="registered")
    assert list(as_odometry(registered)) == list(registered.events)


def test_tf_without_motion_is_refused_as_an_odometry():
    events = [TransformSample(PoseSample(0, "map", "lidar", MOUNT), True)]
    source = source_of(
        [*events, *moving_clouds("lidar", False)], pose_source="tf", fixed_frame="map"
    )
    assert len(list(source)) == 12
    with pytest.raises(InputError, match="no moving transforms") as error:
        as_odometry(source)
    assert len(str(error.value).splitlines()) == 1
