"""Placement in the node: arrival times, counters, and values of /diagnostics."""

from types import SimpleNamespace

import pytest
import raw_rooms
from raw_rooms import in_order

from ellipseg_ros.config import PlacementConfig
from ellipseg_ros.node import health, placing
from ellipseg_ros.node.health import ERROR, OK, WARN, Health
from ellipseg_ros.node.placing import Placed, Placing
from ellipseg_ros.poses.placement import Unplaced
from ellipseg_ros.records import Sweep

CLOUDS, POSES = raw_rooms.clouds(5, points=20), raw_rooms.odometry(5)


@pytest.fixture
def clock(monkeypatch):
    """A clock that only a test turns on."""
    now = SimpleNamespace(s=100.0)
    monkeypatch.setattr(health.time, "monotonic", lambda: now.s)
    return now


@pytest.fixture
def made(clock):
    found = Health()
    found.ready = True
    config = PlacementConfig(pose_source="odometry")
    return SimpleNamespace(health=found, placing=Placing(config, found, "/odom"), clock=clock)


def report(made):
    made.health.placement = made.placing.values()
    made.health.waiting_for = made.placing.problem()
    return made.health.report(0)


def take(made, *events):
    decisions = []
    for event in events:
        if isinstance(event, Sweep):
            made.health.cloud()
        decisions += made.placing.take(event)
    return decisions


def test_latency_of_a_cloud_includes_its_wait_for_a_pose(made):
    for second, cloud in enumerate(CLOUDS[:3]):
        made.clock.s = 100.0 + second
        assert take(made, cloud) == []
    made.clock.s = 110.0
    assert [placed.arrival for placed in take(made, *POSES)] == [100.0, 101.0, 102.0]
    assert take(made, *POSES[:0]) == []


def test_clouds_wait_with_a_warning_after_two_seconds(made):
    take(made, POSES[0], CLOUDS[0])
    made.clock.s += 2.0
    assert report(made).level == OK
    made.clock.s += 0.1
    found = report(made)
    assert (found.level, found.values["clouds waiting for poses"]) == (WARN, "1")
    assert "clouds wait for poses: the newest pose is 0.1" in found.message
    take(made, *POSES[1:])
    found = report(made)
    assert (found.level, found.values["clouds waiting for poses"]) == (OK, "0")
    assert found.values["lag of the odometry [s]"] == "-0.500"


def test_reset_decides_what_waits_and_counts_it(made):
    take(made, *CLOUDS[:2])
    assert report(made).level == OK
    decisions = made.placing.reset()
    assert [type(decision) for decision in decisions] == [Unplaced, Unplaced]
    assert "on /odom: is it published" in decisions[0].text
    found = report(made)
    assert found.level == ERROR
    assert found.message.startswith("every cloud is unplaced: no odometry has arrived on /odom")
    assert found.values["clouds unplaced"] == found.values["clouds unplaced: no_poses"] == "2"
    assert found.values["points unplaced"] == "40"


def test_some_unplaced_clouds_are_a_warning(made):
    decisions = take(made, *POSES[5:], CLOUDS[0], CLOUDS[2])
    assert [type(decision) for decision in decisions] == [Unplaced, Placed]
    found = report(made)
    assert (found.level, found.values["clouds unplaced: before_poses"]) == (WARN, "1")
    assert "1 clouds unplaced: a cloud is 0.0" in found.message
    assert decisions[1].sweep.unplaced == 20


@pytest.mark.parametrize(
    ("shift_s", "distance"), [(10**6, "999999.9"), (-4000, "3999.6"), (-900, "899.6")]
)
def test_stamps_of_another_clock_are_named_with_their_distance(shift_s, distance, made):
    other = [pose._replace(time_ns=pose.time_ns + shift_s * 10**9) for pose in POSES]
    late = [Sweep(CLOUDS[0].stamp_ns + 6 * 10**9, CLOUDS[0].points, frame_id="lidar")]
    texts = [decision.text for decision in take(made, *other, CLOUDS[0], *late)]
    assert f" {distance}" in texts[0]
    assert ("of another clock?" in texts[0]) == (abs(shift_s) > 1000)


def test_jumps_are_counted_and_restart(made):
    moved = [p._replace(pose=p.pose._replace(position=p.pose.position + 9.0)) for p in POSES[13:]]
    decisions = take(made, *in_order(POSES[:13], moved, CLOUDS))
    restarts = [d.sweep.restart for d in decisions if isinstance(d, Placed)]
    assert restarts.count("the poses jumped") == 1
    values = made.placing.values()
    assert values["jumps of the poses"] == "1" and "15.59 m" in values["last jump"]


def test_understood_input_is_described_once(made):
    assert made.placing.new_description() == ""
    take(made, *POSES, CLOUDS[0])
    described = made.placing.new_description()
    assert "cloud frame lidar, point times t [ns] from the stamp, deskew yes" in described
    assert "fixed frame odom" in described and "child frame lidar" in described
    assert made.placing.new_description() == ""


def test_registered_clouds_pass_unchanged():
    found = Placing(PlacementConfig(pose_source="registered"), Health(), "/odom")
    (decision,) = found.take(CLOUDS[0])
    assert decision.sweep is CLOUDS[0]
    assert found.values() == {"pose source": "registered"} and found.problem() == ""
    assert found.reset() == [] and placing.MAX_WAIT_S == 2.0
