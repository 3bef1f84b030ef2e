import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ellipseg_ros.config import ConfigError, PlacementConfig
from ellipseg_ros.poses import placement as module
from ellipseg_ros.poses.placement import Unplaced
from ellipseg_ros.poses.placer import (
    Placer,
    RefusedPose,
    TransformSample,
    outcomes,
    warm_up,
)
from ellipseg_ros.poses.series import PoseSample
from ellipseg_ros.poses.transforms import IDENTITY, transform
from ellipseg_ros.records import Sweep

NS = 10**9
LOOP_S = 50.0
SPEED, YAW_RATE = 12.0, np.radians(30.0)  # m/s, rad/s


def truth(time_s):
    """Position and rotation of the vehicle on a circle; times (n,): n of each."""
    yaw = YAW_RATE * np.asarray(time_s)
    radius = SPEED / YAW_RATE
    position = np.array([radius * np.sin(yaw), radius * (1.0 - np.cos(yaw)), 0.0 * yaw])
    return position.T, Rotation.from_rotvec(np.multiply.outer(yaw, [0.0, 0.0, 1.0]))


def pose(time_s, stamp_s=None, child="base", frame="odom"):
    position, rotation = truth(time_s)
    stamp_ns = round((time_s if stamp_s is None else stamp_s) * NS)
    return PoseSample(stamp_ns, frame, child, transform(position, rotation.as_quat()))


MOUNT = np.array([0.5, 0.0, 1.8])


def measured(world, times_s):
    """World points (n, 3) in the frame of a lidar at MOUNT, each at its own time."""
    position, rotation = truth(times_s)
    return rotation.inv().apply(world - position) - MOUNT


def cloud(points, begin_s, times_s=None, frame_id="lidar"):
    """A cloud with the stamp of its begin; with Ouster's times of points, if given."""
    kinds = [(n, "f4") for n in "xyz"] + ([] if times_s is None else [("t", "u4")])
    fields = np.zeros(len(points), kinds)
    for column, name in enumerate("xyz"):
        fields[name] = points[:, column]
    if times_s is not None:
        fields["t"] = np.rint((times_s - begin_s) * NS)
    return Sweep(round(begin_s * NS), points, fields=fields, frame_id=frame_id)


def run(events, **config):
    """What becomes of the events."""
    settings = {"pose_source": "odometry", "extrinsic": "0.5 0 1.8 0 0 0 1", **config}
    return list(outcomes(events, Placer(PlacementConfig(**settings))))


def placed(found):
    return [outcome for outcome in found if isinstance(outcome, Sweep)]


def reasons(found):
    return [o.reason for o in found if not isinstance(o, Sweep)]


# --- accuracy --------------------------------------------------------------------------------


@pytest.mark.parametrize("meaning", ["exact", "scan_begin", "scan_end"])
def test_moving_points_are_within_a_centimetre_with_every_meaning_of_the_stamp(meaning):
    rng = np.random.default_rng(0)
    events, worlds = [], []
    for k in range(8):
        begin = 100.0 + 0.1 * k
        times = begin + np.sort(rng.uniform(0.0, 0.0999, 400))
        times[[0, -1]] = begin, begin + 0.0999
        world = truth(begin)[0] + rng.uniform(-20.0, 20.0, (400, 3))
        sensor = measured(world, times)
        sensor[rng.random(400) < 0.01] = np.nan
        worlds.append(world)
        events.append(cloud(sensor, begin, times))
        stamp = begin if meaning == "scan_begin" else times[-1]
        events.append(pose(times[-1], stamp))
    found = run(events, odometry_stamp=meaning, deskew="on", min_range=0.0)
    assert len(placed(found)) >= 7 and len(found) == 8
    for sweep, world in zip(placed(found), worlds[-len(placed(found)) :], strict=True):
        errors = np.linalg.norm(sweep.points - world, axis=1)
        known = np.isfinite(errors)
        assert known.mean() > 0.95
        assert np.quantile(errors[known], 0.99) < 0.01
        np.testing.assert_array_equal(np.isnan(sweep.ranges), ~known)


def constant_events(begin_s=100.0, count=5):
    """Clouds of one point at the lidar, with times, and poses at 20 Hz."""
    events = [pose(begin_s + 0.05 * k) for k in range(2 * count + 2)]
    for k in range(count):
        begin = begin_s + 0.1 * k
        events.append(cloud(np.ones((2, 3)), begin, begin + np.array([0.0, 0.1])))
    return sorted(events, key=lambda e: e.stamp_ns if isinstance(e, Sweep) else e.time_ns)


def expected(time_s, points):
    position, rotation = truth(time_s)
    return position + rotation.apply(points + MOUNT)


def test_without_deskew_all_points_move_by_the_pose_of_the_stamp():
    for sweep in placed(run(constant_events(), deskew="off")):
        at = expected(sweep.stamp_ns / NS, np.ones((2, 3)))
        np.testing.assert_allclose(sweep.points, at, rtol=0, atol=1e-6)
        assert not sweep.offsets_ns.any()


def test_with_deskew_points_move_by_their_own_poses():
    found = placed(run(constant_events()))
    assert len(found) == 5
    for sweep in found:
        for row in range(2):
            at = expected(sweep.stamp_ns / NS + 0.1 * row, np.ones((1, 3)))
            np.testing.assert_allclose(sweep.points[row], at[0], rtol=0, atol=1e-6)
        assert sweep.offsets_ns.tolist() == [0, NS // 10]


def test_offset_is_added_to_the_stamps_of_the_odometry():
    events = [pose(100.0 + 0.05 * k, 99.7 + 0.05 * k) for k in range(9)]
    events.append(cloud(np.ones((1, 3)), 100.1))
    (sweep,) = run(events, odometry_offset=0.3)
    np.testing.assert_allclose(sweep.points, expected(100.1, np.ones((1, 3))), atol=1e-6)


def test_required_times_of_points_must_be_there():
    events = [pose(100.0), cloud(np.ones((3, 3)), 100.0), pose(100.1)]
    (lost,) = run(events, deskew="on")
    assert isinstance(lost, Unplaced) and (lost.points, lost.reason) == (3, "no_point_times")
    assert "deskew is on" in lost.text
    assert len(placed(run(events, deskew="auto"))) == 1


def test_points_without_a_valid_time_become_nan_alone():
    points = np.ones((4, 3))
    fields = np.zeros(4, [("timestamp", "f8")])
    fields["timestamp"] = [100.0, 100.02, np.nan, 100.05]
    events = [pose(100.0), pose(100.05), Sweep(100 * NS, points, fields=fields, frame_id="lidar")]
    (sweep,) = run(events)
    assert np.isnan(sweep.points).all(axis=1).tolist() == [False, False, True, False]
    np.testing.assert_allclose(sweep.ranges, np.sqrt(3.0))


# --- frames ----------------------------------------------------------------------------------


def test_registered_clouds_keep_their_points_and_get_ranges():
    rng = np.random.default_rng(1)
    times = 100.0 + np.array([0.0, 0.05, 0.1])
    points = rng.normal(scale=10.0, size=(3, 3))
    points[1] = np.nan
    registered = cloud(points, 100.0, times, "odom")
    (sweep,) = run([pose(100.0), pose(100.05), pose(100.1), registered], extrinsic="")
    np.testing.assert_array_equal(sweep.points, points)
    away = [np.linalg.norm(p - truth(t)[0]) for p, t in zip(points, times, strict=True)]
    np.testing.assert_allclose(sweep.ranges, away, atol=1e-9)
    assert sweep.fields is registered.fields


def test_registered_points_without_a_valid_time_are_kept():
    fields = np.zeros(3, [("timestamp", "f8")])
    fields["timestamp"] = [100.0, np.nan, 100.05]
    registered = Sweep(100 * NS, np.ones((3, 3)), fields=fields, frame_id="odom")
    (sweep,) = run([pose(100.0), pose(100.05), registered], extrinsic="")
    np.testing.assert_array_equal(sweep.points, np.ones((3, 3)))


def test_each_lidar_has_its_extrinsic_and_a_given_one_overrides_names():
    table = "front: 1 0 0 0 0 0 1; rear: -1 0 0 0 0 1 0"
    point = np.array([[2.0, 0.0, 0.0]])
    events = [PoseSample(0, "odom", "body", IDENTITY)]
    events += [cloud(point, 0.0, frame_id=name) for name in ("front", "rear", "/rear")]
    found = run(events, extrinsic=table)
    np.testing.assert_allclose([s.points[0, 0] for s in found], [3.0, -3.0, -3.0], atol=1e-12)
    (sweep,) = run([events[0], cloud(point, 0.0, frame_id="odom")], extrinsic="5 0 0 0 0 0 1")
    np.testing.assert_allclose(sweep.points, [[7.0, 0.0, 0.0]])


def test_names_of_frames_may_have_a_leading_slash():
    events = [PoseSample(0, "/odom", "/lidar", IDENTITY), cloud(np.ones((1, 3)), 0.0)]
    events.append(cloud(np.ones((1, 3)), 0.0, frame_id="odom"))
    raw, registered = run(events, extrinsic="")
    np.testing.assert_array_equal(raw.points, np.ones((1, 3)))
    assert registered.fields.dtype.names == ("x", "y", "z") and raw.fields is None


def test_static_transform_joins_the_lidar_to_the_odometry_even_if_it_comes_later():
    mount = PoseSample(0, "base", "lidar", transform([0.0, 0.0, 3.0], [0.0, 0.0, 0.0, 1.0]))
    events = [cloud(np.ones((1, 3)), 0.0), PoseSample(0, "odom", "base", IDENTITY)]
    (lost,) = run(events, extrinsic="")
    assert lost.reason == "no_extrinsic" and "'base'" in lost.text and "'lidar'" in lost.text
    (sweep,) = run([*events, TransformSample(mount, static=True)], extrinsic="")
    np.testing.assert_array_equal(sweep.points, [[1.0, 1.0, 4.0]])


def test_odometry_has_one_pair_of_frames():
    events = [pose(1.0), pose(1.1, child="other"), pose(1.2, frame="map")]
    found = run(events)
    assert reasons(found) == ["odometry_frame"] * 2
    assert "'base' to 'other'" in found[0].text and "'odom' to 'map'" in found[1].text


def test_tf_needs_a_fixed_frame():
    with pytest.raises(ConfigError, match="fixed_frame"):
        Placer(PlacementConfig(pose_source="tf"))


def test_registered_source_passes_clouds_unchanged():
    sweep = cloud(np.ones((1, 3)), 1.0)
    assert run([pose(1.0), sweep], pose_source="registered") == [sweep]
    warm_up()


# --- filters and accounting --------------------------------------------------------------------


def test_filtered_and_unplaced_points_are_counted():
    near, self_hit, far, good = [0.0] * 3, [0.5, 0.0, 0.0], [50.0, 0.0, 0.0], [5.0, 0.0, 0.0]
    points = np.array([near, good, self_hit, far, [np.nan] * 3, good])
    early, late = cloud(np.ones((7, 3)), 99.0), cloud(points, 100.0)
    settings = {"min_range": 0.2, "max_range": 40.0, "self_filter": "-1 -1 -1 1 1 1"}
    lost, sweep = run([pose(100.0), early, late], **settings)
    assert (lost.points, lost.reason) == (7, "before_poses")
    assert (len(sweep), sweep.filtered, sweep.unplaced) == (3, 3, 7)
    np.testing.assert_allclose(sweep.ranges, [5.0, np.nan, 5.0])


def test_poses_that_jump_restart_the_window():
    moved = [PoseSample(round(t * NS), "odom", "base", IDENTITY) for t in np.arange(1.0, 2.0, 0.1)]
    far = transform([50.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0])
    moved += [PoseSample(round(t * NS), "odom", "base", far) for t in np.arange(2.0, 3.0, 0.1)]
    clouds = [cloud(np.ones((1, 3)), t) for t in (1.1, 1.75, 1.95, 2.15, 2.25)]
    found = run([*moved, *clouds])
    assert reasons(found) == ["pose_jump"]
    assert [s.restart for s in placed(found)] == ["", "", "the poses jumped", ""]
    assert [s.unplaced for s in placed(found)] == [0, 0, 1, 0]


def test_clouds_wait_5_s_of_their_stamps_for_poses():
    placer = Placer(PlacementConfig(pose_source="odometry"))
    for k in range(51):
        assert placer.take(cloud(np.ones((1, 3)), 0.1 * k)) == []
    (lost,) = placer.take(cloud(np.ones((1, 3)), 5.1))
    assert lost.reason == "no_poses" and placer.placement.waiting == 51
    assert reasons(placer.flush()) == ["no_poses"] * 51 and placer.placement.waiting == 0


def test_clouds_that_wait_are_bounded(monkeypatch):
    monkeypatch.setattr(module, "MAX_WAITING_POINTS", 10)
    placer = Placer(PlacementConfig(pose_source="odometry"))
    assert [len(placer.take(cloud(np.ones((4, 3)), 0.0))) for _ in range(4)] == [0, 0, 1, 1]


def test_reset_forgets_poses_and_clouds():
    placer = Placer(PlacementConfig(pose_source="odometry", extrinsic="0 0 0 0 0 0 1"))
    placer.take(pose(1.0))
    placer.take(cloud(np.ones((1, 3)), 2.0))
    placer.reset()
    assert placer.placement.waiting == 0 and placer.flush() == []
    placer.take(cloud(np.ones((1, 3)), 1.0))
    assert reasons(placer.flush()) == ["no_poses"]


# --- independence of the interleaving ------------------------------------------------------------


def random_streams(rng):
    """Clouds and poses, each in its own order: gaps, jumps, a late start, NaN, loops.

    Stamps jump back by 50 s after each loop.
    """
    clouds, poses = [], []
    for loop in range(int(rng.integers(1, 4))):
        begin, moved = 1000.0 - LOOP_S * loop, 0.0
        times = np.arange(begin + rng.uniform(-0.2, 0.5), begin + 6.0, 0.05)
        gap = begin + rng.uniform(1.0, 4.0)
        times = times[(times < gap) | (times > gap + rng.choice([0.0, 0.4, 1.5]))]
        jump = begin + rng.uniform(1.0, 5.0)
        for time_s in times:
            if time_s > jump and not moved:
                moved = rng.choice([0.1, 30.0])
            sample = pose(time_s)
            far = transform(sample.pose.position + moved, sample.pose.rotation)
            poses.append(sample._replace(pose=far))
            if rng.random() < 0.02:
                poses.append(sample._replace(time_ns=sample.time_ns - NS // 2))  # is refused
        for begin_s in np.arange(begin, begin + 6.0, 0.1):
            count = int(rng.integers(1, 6))
            points = rng.normal(scale=10.0, size=(count, 3))
            points[rng.random(count) < 0.1] = np.nan
            times = begin_s + np.sort(rng.uniform(0.0, 0.1, count))
            clouds.append(cloud(points, begin_s, times if rng.random() < 0.8 else None))
    return clouds, poses


def interleaved(clouds, poses, rng):
    """Both in one order of arrival; neither is more than 4 s behind the other."""
    lag = rng.uniform(-2.0, 2.0)
    arrival = []
    for stream, delay in ((clouds, 0.0), (poses, lag)):
        stamps = [e.stamp_ns if isinstance(e, Sweep) else e.time_ns for e in stream]
        times = np.array(stamps) / NS
        loops = np.rint((1003.0 - times) / LOOP_S)
        noise = rng.uniform(0.0, rng.choice([0.01, 0.5, 2.0]), len(times))
        arrival.append(np.maximum.accumulate(times + 1000.0 * loops + delay + noise))
    events = [*clouds, *poses]
    return [events[k] for k in np.argsort(np.concatenate(arrival), kind="stable")]


def same(a, b):
    assert type(a) is type(b)
    if isinstance(a, Unplaced):
        return (a.points, a.reason) == (b.points, b.reason)
    for name in ("points", "offsets_ns", "ranges"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    names = ("stamp_ns", "frame_id", "restart", "filtered", "unplaced")
    assert [getattr(a, n) for n in names] == [getattr(b, n) for n in names]
    return True


def check_points(found, clouds):
    """Every cloud comes out once, in order, and the points add up."""
    assert len(found) == len(clouds)
    lost = 0
    for outcome, raw in zip(found, clouds, strict=True):
        if isinstance(outcome, Unplaced):
            assert outcome.points == len(raw)
            lost += outcome.points
            continue
        assert outcome.stamp_ns == raw.stamp_ns and outcome.unplaced == lost
        assert len(outcome) + outcome.filtered == len(raw)
        lost = 0


@pytest.mark.nojit
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("meaning", ["exact", "scan_begin"])
def test_outcome_does_not_depend_on_the_interleaving(seed, meaning):
    rng = np.random.default_rng(seed)
    clouds, poses = random_streams(rng)
    first = None
    for _ in range(3):
        events = interleaved(clouds, poses, rng)
        found = run(events, odometry_stamp=meaning, min_range=3.0)
        found = [outcome for outcome in found if not isinstance(outcome, RefusedPose)]
        check_points(found, clouds)
        first = first or found
        assert all(same(a, b) for a, b in zip(found, first, strict=True))
    assert len(clouds) // 4 < len(placed(found)) < len(clouds)


def random_links(rng, loops):
    """Samples of map -> odom at 10 Hz and of odom -> base at 20 Hz: gaps, loops, a late start."""
    upper, lower = [], []
    for loop in range(loops):
        begin = 1000.0 - LOOP_S * loop
        for link, frames, rate in (
            (upper, ("map", "odom"), 10.0),
            (lower, ("odom", "base"), 20.0),
        ):
            times = np.arange(begin + rng.uniform(-0.2, 0.5), begin + 6.0, 1.0 / rate)
            gap = begin + rng.uniform(1.0, 4.0)
            times = times[(times < gap) | (times > gap + rng.choice([0.0, 0.4, 1.5]))]
            jump = begin + rng.uniform(1.0, 5.0)
            for time_s in times:
                sample = pose(0.1 * time_s if link is upper else time_s)
                far = sample.pose.position + (20.0 if time_s > jump else 0.0)
                moved = transform(far, sample.pose.rotation)
                link.append(
                    TransformSample(PoseSample(round(time_s * NS), *frames, moved), static=False)
                )
    return upper, lower


def mixed(streams, rng):
    """All in one order of arrival; none is more than 4 s behind another."""
    arrival = []
    for stream in streams:
        stamps = [e.stamp_ns if isinstance(e, Sweep) else e.sample.time_ns for e in stream]
        times = np.array(stamps) / NS
        loops = np.rint((1003.0 - times) / LOOP_S)
        noise = rng.uniform(0.0, rng.choice([0.01, 0.5, 2.0]), len(times))
        delay = rng.uniform(-1.0, 1.0)
        arrival.append(np.maximum.accumulate(times + 1000.0 * loops + delay + noise))
    events = [event for stream in streams for event in stream]
    return [events[k] for k in np.argsort(np.concatenate(arrival), kind="stable")]


@pytest.mark.nojit
@pytest.mark.parametrize("seed", range(4))
def test_outcome_does_not_depend_on_the_interleaving_of_two_moving_transforms(seed):
    rng = np.random.default_rng(seed)
    clouds, _ = random_streams(rng)
    links = random_links(rng, loops=1 + max(int(1003 - c.stamp_ns / NS) for c in clouds) // 50)
    mount = TransformSample(PoseSample(0, "base", "lidar", transform(MOUNT, [0, 0, 0, 1])), True)
    first = None
    for _ in range(3):
        events = [mount, *mixed((clouds, *links), rng)]
        found = run(events, pose_source="tf", fixed_frame="map", extrinsic="", min_range=3.0)
        check_points(found, clouds)
        first = first or found
        assert all(same(a, b) for a, b in zip(found, first, strict=True))
    assert len(clouds) // 4 < len(placed(found)) < len(clouds)
    assert {"pose_jump", "before_poses"} & set(reasons(found))


# --- stamps that jump back in one stream ---------------------------------------------------------


def arriving(clouds_back_s, poses_back_s, links):
    """Clouds at 10 Hz and poses at 20 Hz for 20 s; after 6 s, the stamps of one jump back.

    links: poses as transforms. -> the events, and the clouds.
    """
    events, clouds = [], []
    for k in range(400):
        time_s = 1000.0 + 0.05 * k
        stamp_s = time_s - (poses_back_s if k >= 120 else 0.0)
        sample = pose(stamp_s)
        events.append(TransformSample(sample, static=False) if links else sample)
        if k % 2:
            begin = time_s - (clouds_back_s if k >= 120 else 0.0)
            clouds.append(cloud(np.ones((2, 3)), begin, begin + np.array([0.0, 0.04])))
            events.append(clouds[-1])
    mount = PoseSample(0, "base", "lidar", transform(MOUNT, [0.0, 0.0, 0.0, 1.0]))
    return [TransformSample(mount, static=True), *events], clouds


@pytest.mark.parametrize("links", [False, True])
@pytest.mark.parametrize(("clouds_back_s", "poses_back_s"), [(2.0, 0.0), (0.0, 2.0), (4.0, 0.0)])
def test_at_most_5_s_of_clouds_are_lost_where_one_stream_jumps_back(
    links, clouds_back_s, poses_back_s
):
    events, clouds = arriving(clouds_back_s, poses_back_s, links)
    source = {"pose_source": "tf", "fixed_frame": "odom"} if links else {}
    found = run(events, extrinsic="", **source)
    check_points(found, clouds)
    lost = [row for row, outcome in enumerate(found) if isinstance(outcome, Unplaced)]
    assert 60 in lost  # the first after the jump
    end = 200 - round(10 * poses_back_s) - 1  # later ones have no pose before the end
    within = [row for row in lost if row < end]
    # The cloud 59 ends after the last pose before the jump of the poses.
    assert 59 <= min(within) and max(within) <= 60 + 50
    for outcome in found[max(within) + 1 : end]:
        for row, time_s in enumerate((outcome.stamp_ns / NS, outcome.stamp_ns / NS + 0.04)):
            at = expected(time_s, np.ones((1, 3)))[0]
            np.testing.assert_allclose(outcome.points[row], at, rtol=0, atol=2e-3)
