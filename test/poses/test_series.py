import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ellipseg_ros.errors import InputError
from ellipseg_ros.poses import series as module
from ellipseg_ros.poses.series import PoseSeries
from ellipseg_ros.poses.transforms import IDENTITY, transform

NS = 10**9


def at(x, yaw=0.0):
    return transform([x, 0.0, 0.0], Rotation.from_euler("z", yaw).as_quat())


def series(times_s, poses=None, jump_m=1.0, max_gap_s=1.0):
    found = PoseSeries(jump_m, round(max_gap_s * NS))
    for row, time_s in enumerate(times_s):
        found.add(round(time_s * NS), IDENTITY if poses is None else poses[row])
    return found


def refused(call, reason):
    with pytest.raises(InputError) as error:
        call()
    assert error.value.reason == reason and len(str(error.value).splitlines()) == 1
    return str(error.value)


def seconds(poses):
    return (poses["time_ns"] / NS).tolist()


def test_stretch_is_from_the_last_pose_before_to_the_first_after():
    found = series([1.0, 1.5, 2.0, 2.5])
    assert seconds(found.stretch(0, int(1.6 * NS), int(1.9 * NS))) == [1.5, 2.0]
    assert seconds(found.stretch(0, int(1.5 * NS), int(2.0 * NS))) == [1.5, 2.0]
    assert seconds(found.stretch(0, int(1.5 * NS), int(1.5 * NS))) == [1.5]
    assert seconds(found.stretch(0, NS, int(2.5 * NS))) == [1.0, 1.5, 2.0, 2.5]


def test_stretch_waits_for_a_pose_after_the_end_and_refuses_times_before_the_first():
    found = series([1.0, 2.0])
    assert found.stretch(0, NS, 2 * NS + 1) is None
    assert "0.500 s older than the first pose" in refused(
        lambda: found.stretch(0, NS // 2, NS), "before_poses"
    )
    assert series([]).stretch(0, 0, 0) is None


def test_gap_is_refused_with_its_length_and_the_setting():
    found = series([0.0, 1.0, 2.5, 3.0])
    text = refused(lambda: found.stretch(0, NS // 2, 3 * NS), "pose_gap")
    assert "1.500 s" in text and "max_pose_gap" in text
    assert len(found.stretch(0, 0, NS)) == 2 and len(found.stretch(0, int(2.5 * NS), 3 * NS)) == 2


def test_older_and_equal_poses_are_refused():
    found = series([1.0, 2.0])
    for time_s in (1.0, 1.5, 2.0):
        text = refused(lambda time_s=time_s: found.add(round(time_s * NS), IDENTITY), "pose_order")
        assert "order of time" in text
    assert found.newest_ns == 2 * NS and found.last_epoch == 0


def drive(times_s, speed, yaw_rate, acceleration=0.0):
    return [at(speed * t + acceleration * t * t / 2, yaw_rate * t) for t in times_s]


@pytest.mark.parametrize("rate", [10.0, 100.0])
@pytest.mark.parametrize("missing", [0.0, 0.5])
@pytest.mark.parametrize("acceleration", [0.0, -8.0])
def test_fast_driving_is_no_jump(rate, missing, acceleration):
    rng = np.random.default_rng(0)
    times = np.arange(0.0, 1.5, 1.0 / rate)
    times = times[(rng.random(len(times)) >= missing) | (times == 0.0)]
    found = series(times, drive(times, 12.0, np.radians(30.0), acceleration))
    assert found.jumps == 0 and not found.jump


@pytest.mark.parametrize("rate", [10.0, 100.0])
@pytest.mark.parametrize(
    ("metres", "degrees", "text"), [(1.2, 0.0, "1.20 m"), (0.0, 30.0, "30.0 deg")]
)
def test_jump_divides_the_poses_into_runs(rate, metres, degrees, text):
    times = np.arange(10.0, 12.0, 1.0 / rate)
    half = len(times) // 2
    poses = drive(times, 5.0, 0.1)
    moved = [at(5.0 * t + metres, 0.1 * t + np.radians(degrees)) for t in times]
    found = series(times, poses[:half] + moved[half:])
    assert found.jumps == 1 and text in found.jump
    begin, end = round(times[0] * NS), round(times[-1] * NS)
    refused(lambda: found.stretch(0, begin, end), "pose_jump")
    assert set(found.stretch(0, begin, round(times[half - 1] * NS))["run"]) == {0}
    assert set(found.stretch(0, round(times[half] * NS), end)["run"]) == {1}


def noisy_drive(rng, rate=200.0, twins=0.3):
    """Times, and positions x with 1 cm of noise; many poses have a twin 0.1 ms later."""
    times = np.arange(0.0, 2.0, 1.0 / rate)
    times = np.sort(np.concatenate([times, times[rng.random(len(times)) < twins] + 1e-4]))
    return times, 12.0 * times + rng.normal(scale=0.01, size=len(times))


@pytest.mark.parametrize("seed", range(10))
def test_noise_of_poses_with_nearly_equal_stamps_is_no_jump(seed):
    rng = np.random.default_rng(seed)
    times, x = noisy_drive(rng)
    if seed % 2:  # the first velocity would be that between twins
        times[1] = times[0] + 1e-4
    yaws = rng.normal(scale=np.radians(0.2), size=len(times))
    found = series(times, [at(*pose) for pose in zip(x, yaws, strict=True)])
    assert found.jumps == 0 and not found.jump


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("between_twins", [False, True])
def test_jump_is_found_among_noise_and_nearly_equal_stamps(seed, between_twins):
    rng = np.random.default_rng(seed)
    times, x = noisy_drive(rng)
    steps = np.diff(times) < 1e-3
    row = int(rng.choice(np.flatnonzero(steps == between_twins)[20:-20])) + 1
    x[row:] += 1.5
    found = series(times, [at(value) for value in x])
    assert found.jumps == 1
    runs = found.poses["run"]
    assert not runs[:row].any() and (runs[row:] == 1).all()


def test_velocity_is_taken_within_one_run():
    """Right after a jump, the velocity across it would predict the next pose far away."""
    times = np.array([0.0, 0.1, 0.2, 0.3, 0.301, 0.401, 0.501])
    found = series(times, [at(x) for x in (0.0, 0.0, 0.0, 5.0, 5.0, 5.0, 5.0)])
    assert found.poses["run"].tolist() == [0, 0, 0, 1, 1, 1, 1]


def test_jumps_may_be_ignored():
    times = np.arange(5.0)
    poses = [at(0.0), at(0.0), at(0.0), at(500.0), at(500.0)]
    assert series(times, poses).jumps == 1
    ignoring = series(times, poses, jump_m=0.0)
    assert ignoring.jumps == 0 and len(ignoring.stretch(0, 0, 4 * NS)) == 5


def test_looping_bag_starts_epochs():
    found = series([10.0, 10.5, 11.0, 1.0, 1.5, 2.0])
    assert found.last_epoch == 1 and found.newest_ns == 2 * NS
    assert seconds(found.stretch(0, int(10.2 * NS), 11 * NS)) == [10.0, 10.5, 11.0]
    assert seconds(found.stretch(1, int(1.2 * NS), int(1.4 * NS))) == [1.0, 1.5]
    assert found.stretch(2, NS, NS) is None  # the clouds have jumped back first
    assert found.stretch(1, int(2.2 * NS), int(2.3 * NS)) is None
    refused(lambda: found.stretch(0, int(10.9 * NS), int(11.1 * NS)), "poses_back")


def test_poses_that_jump_back_alone_serve_the_clouds_once_they_catch_up():
    found = series([100.0, 100.5, 50.0])
    for time_s in np.arange(50.5, 107.0, 0.5):
        found.add(round(time_s * NS), IDENTITY)
    assert found.last_epoch == 1
    assert seconds(found.stretch(0, 106 * NS, 106 * NS)) == [106.0]


def test_old_epochs_and_poses_are_dropped(monkeypatch):
    monkeypatch.setattr(module, "MAX_POSES", 100)
    found = PoseSeries(1.0, NS)
    for loop in range(2 * module.MAX_EPOCHS):
        for k in range(130):
            found.add(10 * NS + k * NS // 10, IDENTITY)
        assert found.last_epoch == loop and found.newest_ns == 10 * NS + 129 * NS // 10
    assert len(found._epochs) == module.MAX_EPOCHS
    assert max(len(epoch.values) for epoch in found._epochs) <= 100
    assert len(found.stretch(found.last_epoch, 22 * NS, 22 * NS + 1)) == 2
