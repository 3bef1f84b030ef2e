"""A short flood of service calls, and verdicts on a node that is disturbed."""

from dataclasses import replace

import pytest

from ellipseg_ros.ros.segmenter_node import RESET_QUOTA
from ellipseg_ros.simulation.simulator import simulate
from studies.endurance.hostile_clients import (
    Calls,
    Drive,
    Flood,
    answered,
    replay_flooded,
    undisturbed,
)

QUIET = Drive(updates=8, expected=7, lost=0, latency=0.2, points=[0, 900, 800])
FLOODED = replace(QUIET, latency=0.9, flood=Flood(8.0, {"set_parameters": Calls(800, 800, 0)}))


def test_a_flood_is_answered_and_the_node_continues():
    drive = replay_flooded(["set_parameters", "reset", "tune"], 5.0, seed=1)
    assert drive.updates >= drive.expected and not drive.lost
    calls = drive.flood.calls
    assert calls.keys() == {"set_parameters", "reset", "tune"}
    assert all(service.answered == service.sent > 10 for service in calls.values())
    assert drive.flood.seconds >= 5.0 and 0.0 < drive.latency < 60.0
    assert calls["set_parameters"].granted == 0
    assert calls["tune"].granted < calls["tune"].sent
    # All resets of a minute are used at the start, before the drive, and then the window fills.
    assert calls["reset"].granted == RESET_QUOTA[0]
    assert drive.points[-1] > sum(map(len, simulate("industrial", duration=5.0, seed=1))) / 2


@pytest.mark.parametrize(
    "change", [{"latency": 1.1}, {"lost": 1}, {"updates": 6}, {"points": [900, 100, 90]}]
)
def test_a_disturbed_node_does_not_meet_the_requirement(change):
    assert undisturbed(QUIET, {"parameters": FLOODED}, "").met
    assert not undisturbed(QUIET, {"parameters": replace(FLOODED, **change)}, "").met


@pytest.mark.parametrize(
    ("name", "calls"),
    [
        ("~/tune", {}),
        ("~/tune", {"tune": Calls(4, 0, 0)}),
        ("~/tune", {"tune": Calls(900, 899, 1)}),
        ("~/tune", {"tune": Calls(4, 4, 0)}),  # no more than were called at the start
        ("parameters", {"set_parameters": Calls(9, 9, 1)}),  # one that had to be refused
    ],
)
def test_calls_without_an_answer_do_not_meet_the_requirement(name, calls):
    drives = {
        "parameters": FLOODED,
        "~/tune": replace(QUIET, flood=Flood(1.0, {"tune": Calls(9, 9, 1)})),
    }
    assert answered(drives, "").met
    assert not answered(drives | {name: replace(QUIET, flood=Flood(1.0, calls))}, "").met
