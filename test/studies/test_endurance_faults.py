"""Fault injection: short versions with the real programs, and verdicts on recorded results.

Limits of time are for the full versions: here the machine is busy with other tests.
"""

from pathlib import Path
from types import SimpleNamespace

import pytest

from studies.endurance import bag_writer_kills, caches, disks, kills, multi_node, signals
from studies.endurance.kills import Restarts, restart_requirements
from studies.endurance.requirements import Options
from studies.endurance.rig import Rig, is_unbroken
from studies.endurance.ros.recording_subscriber import ReceivedUpdate
from studies.endurance.running import SendTimes
from studies.endurance.signals import Ending, Program, problem

TESTS = [
    kills.killed_nodes,
    kills.killed_replayers,
    kills.killed_subscribers,
    bag_writer_kills.killed_writers,
    disks.full_disks,
    disks.forbidden_folders,
    signals.signals,
    caches.damaged_caches,
    caches.shared_caches,
    multi_node.second_nodes,
    multi_node.namespaces,
    multi_node.hanging_subscribers,
]


@pytest.mark.parametrize("run", TESTS, ids=lambda run: run.__name__)
def test_the_requirements_hold(run):
    rows = run(Options(quick=True))
    assert rows and not [row for row in rows if not row.holds]


# --- signals ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("usual", "code", "seconds", "text", "expected"),
    [
        (0, 0, 0.1, "", ""),
        (0, 0, 9.0, "", ""),  # the limit of time is judged elsewhere
        (0, 1, 0.1, "", "exit code 1"),
        (0, 0, 0.1, "Traceback (most recent call last)", "a traceback"),
        (130, 130, 0.1, "ellipseg: interrupted", ""),
        (130, 130, 0.1, "", "without exactly one"),
        (130, 130, 0.1, "ellipseg: interrupted\n" * 2, "without exactly one"),
        (130, 0, 0.1, "", ""),  # it had finished
        (130, 0, 2.1, "", "it continued"),
        (130, 0, 0.1, "ellipseg: interrupted", "exit code 0"),
        (130, -2, 0.1, "", "exit code -2"),
    ],
)
def test_a_wrong_end_of_a_program_is_described(usual, code, seconds, text, expected):
    description = problem(Program([], 1.0, usual), code, seconds, text)
    assert expected in description and bool(description) == bool(expected)


@pytest.mark.parametrize(
    ("seconds", "text", "holds", "within_limits"),
    [(0.1, "", True, True), (2.1, "", True, False), (0.1, "a traceback", False, True)],
)
def test_every_program_must_end_in_time(seconds, text, holds, within_limits):
    endings = iter([Ending("the first", seconds, text)])
    good = Ending("another", 0.1, "")
    (row,) = signals.signals(Options(quick=True), lambda *_: next(endings, good))
    assert (row.holds, row.within_limits) == (holds, within_limits)
    assert row.met == (holds and within_limits)
    assert ("3 of 4" in row.measured and "the first" in row.measured) == (not row.met)


# --- kills -----------------------------------------------------------------------------------


def restarted_rig(full, stale_marker):
    """A node killed and restarted at 10 s; a message of the dead one arrives afterwards."""
    late = ReceivedUpdate(10.1, 1, 40, "odom", full=False, in_sync=True)
    first = ReceivedUpdate(11.0, 2, 0, "odom", full=full, in_sync=True)
    subscriber = SimpleNamespace(marker_updates=[(1, True), (2, stale_marker)])
    subscriber.since = lambda moment: [one for one in (late, first) if one.time > moment]
    subscriber.wait = lambda done, *_: done() or pytest.fail("not done")
    sent = SendTimes({1: round(9.9e9), 2: round(10.9e9)})
    return Rig([], subscriber, Path(), sent), first


def test_messages_of_a_dead_node_are_not_attributed_to_the_new_one():
    rig, first = restarted_rig(full=True, stale_marker=False)
    assert rig.wait_for_new_node(10.0) == 1.0
    assert rig.updates_of_new_node(10.0) == [first]


@pytest.mark.parametrize("full", [True, False])
@pytest.mark.parametrize("stale_marker", [True, False])
def test_a_new_node_must_send_everything_and_delete_markers(full, stale_marker):
    rig, _ = restarted_rig(full, stale_marker)
    restarts = Restarts([1.0, 2.0])
    restarts.judge(rig, 10.0)
    sync, markers = restart_requirements(restarts, {kills.MARKER_LIFETIME_S}, 1)
    assert (sync.met, markers.met) == (full, not stale_marker)


@pytest.mark.parametrize(
    ("numbers", "unbroken"),
    [
        ((3, 4, 4, 5), True),  # a message that is sent again
        ((0, 1, 2, 0, 1, 2, 3), False),  # a restart
        ((0, 2), False),
    ],
)
def test_a_gap_in_the_update_numbers_is_detected(numbers, unbroken):
    updates = [ReceivedUpdate(1.0, 1, n, "odom", full=True, in_sync=True) for n in numbers]
    rig = Rig([], SimpleNamespace(updates=updates), Path())
    assert is_unbroken(rig.sequence()) == unbroken
