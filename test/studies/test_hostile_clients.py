"""The trial with a flood of calls, short, and what it would say of a node that starves."""

from dataclasses import replace

from ellipseg_ros.ros.segmenter_node import RESET_QUOTA
from ellipseg_ros.simulation.simulator import simulate
from studies.endurance.hostile_clients import Calls, Case, Flood, _answers, _goes_on, drive

QUIET = Case(updates=8, expected=7, lost=0, latency=0.2, points=[0, 900, 800])
FLOODED = replace(QUIET, latency=0.9, flood=Flood(8.0, {"set_parameters": Calls(800, 800, 0)}))


def test_a_flood_is_answered_and_the_node_goes_on():
    found = drive(["set_parameters", "reset", "tune"], 5.0, seed=1)
    assert found.updates >= found.expected and not found.lost
    calls = found.flood.calls
    assert calls.keys() == {"set_parameters", "reset", "tune"}
    assert all(of_one.answered == of_one.asked > 10 for of_one in calls.values())
    assert found.flood.seconds >= 5.0 and 0.0 < found.latency < 60.0
    assert calls["set_parameters"].granted == 0
    assert calls["tune"].granted < calls["tune"].asked
    # All resets of a minute come at once, before the drive, and then the window fills.
    assert calls["reset"].granted == RESET_QUOTA[0]
    assert found.points[-1] > sum(map(len, simulate("industrial", duration=5.0, seed=1))) / 2


def test_a_node_that_starves_breaks_the_promise():
    for broken in (
        replace(FLOODED, latency=1.1),
        replace(FLOODED, lost=1),
        replace(FLOODED, updates=6),
        replace(FLOODED, points=[900, 100, 90]),
    ):
        assert _goes_on(QUIET, {"parameters": FLOODED}, "").kept
        assert not _goes_on(QUIET, {"parameters": broken}, "").kept


def test_calls_without_an_answer_break_the_promise():
    def flooded(**calls):
        return replace(QUIET, flood=Flood(1.0, calls))

    floods = {"parameters": FLOODED, "~/tune": flooded(tune=Calls(9, 9, 1))}
    assert _answers(floods, "").kept
    for name, calls in (
        ("~/tune", {}),
        ("~/tune", {"tune": Calls(4, 0, 0)}),
        ("~/tune", {"tune": Calls(900, 899, 1)}),
        ("~/tune", {"tune": Calls(4, 4, 0)}),  # no more than were called at the beginning
        ("parameters", {"set_parameters": Calls(9, 9, 1)}),  # one that had to be refused
    ):
        broken = floods | {name: flooded(**calls)}
        assert not _answers(broken, "").kept
