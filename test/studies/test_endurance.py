"""The trials of reliability can fail: each of their checks sees what it is there to see."""

import json
from collections import deque
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from ellipseg_ros.cli.main import main
from ellipseg_ros.config import Config
from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.io import topics
from ellipseg_ros.io.bag import node_types
from ellipseg_ros.io.messages import write_segments
from ellipseg_ros.io.pointcloud2 import labelled_fields
from ellipseg_ros.node.memory import state_bytes
from ellipseg_ros.records import SECOND
from ellipseg_ros.segmenter import Segmenter
from studies.endurance import subjects
from studies.endurance.endless_drive import Tape
from studies.endurance.endurance import equal_segments
from studies.endurance.fault_kills import Restarts, Scene, unbroken
from studies.endurance.fault_signals import Ending, Program, _problem, signals
from studies.endurance.last_word import COUNTS, last_word
from studies.endurance.overload import (
    QUICK,
    Case,
    _bound,
    _counted,
    _newest,
    _peaks,
    _recovery,
    recovery,
)
from studies.endurance.promises import Promise, Trial
from studies.endurance.ros.recording_subscriber import Heard


def test_a_tape_goes_on_in_time_and_place_with_new_noise():
    tape = Tape(1.0, 3)
    sweeps = list(tape)
    assert len(sweeps) == len(tape) == 30
    assert set(np.diff([sweep.stamp_ns for sweep in sweeps])) == {SECOND // 10}
    first, second = sweeps[4], sweeps[14]
    moved = second.points - first.points
    assert np.hypot(*np.median(moved, axis=0)[:2]) > 1.0
    assert 0.012 < np.std(moved[:, 0]) < 0.016  # sqrt(2) times 1 cm
    for name, column in zip("xyz", second.points.T, strict=True):
        assert np.array_equal(second.fields[name], column)
    again = list(replace(tape, first=2, laps=1))
    assert all(np.array_equal(a.points, b.points) for a, b in zip(sweeps[20:], again, strict=True))


def test_a_tape_has_the_rate_that_is_asked_for():
    for rate in (1000.0, 30_000.0):
        points = sum(map(len, Tape(2.0, 1, rate)))
        assert points / 2.0 == pytest.approx(rate, rel=0.05)


def test_the_size_of_a_state_is_that_of_its_arrays_and_lists():
    def state():
        return SimpleNamespace(
            table=np.zeros(1000), view=np.zeros(10_000)[:3], parts=deque([np.ones(10)]), names={}
        )

    plain = state_bytes(state())
    assert 88_000 < plain < 89_000  # a view keeps all of its array
    grown = state()
    grown.parts.extend(np.ones(10) for _ in range(9))
    assert state_bytes(grown) == plain + 9 * (80 + 8)
    grown.names.update({k: k for k in range(1000)})
    assert state_bytes(grown) >= plain + 16_000
    grown.same = grown.table
    assert state_bytes(grown) - plain < 17_000


@pytest.fixture(scope="module")
def found():
    segmenter = Segmenter(Config(window_duration=1.0))
    return segmenter.process(next(iter(Tape(0.5, 1))))


def told(found):
    data = write_segments(found)
    return node_types().deserialize_cdr(data, topics.SEGMENTS.type), labelled_fields(found)


def test_a_result_of_other_ids_is_equal_and_any_other_is_not(found):
    said, fields = told(replace(found, ids=found.ids[::-1] + np.uint32(100)))
    assert equal_segments(found, said, fields)
    for change in (
        lambda said, fields: setattr(said.segments[3], "covariance", np.ones(9)),
        lambda said, fields: setattr(said.segments[0], "count", 1),
        lambda said, fields: setattr(said.segments[0], "aicc", 1.0),
        lambda said, fields: setattr(said, "aicc", np.nextafter(said.aicc, 0.0)),
        lambda said, fields: said.segments.pop(),
        lambda said, fields: fields["label"].__setitem__(slice(0, 5), 0),
        lambda said, fields: fields["x"].__setitem__(7, 0.0),
        lambda said, fields: fields["label"].__setitem__(
            fields["label"] == said.segments[0].id, said.segments[1].id
        ),
    ):
        said, fields = told(found)
        change(said, fields)
        assert not equal_segments(found, said, fields)


@pytest.mark.parametrize(("late", "seconds"), [(0, 0.0), (4, 3.0), (12, 11.0)])
def test_recovery_is_until_the_last_late_update_but_two(late, seconds):
    stamp = np.arange(40.0)
    latency = np.where((stamp < 20 + late) | np.isin(stamp, [35.0, 36.0]), 5.0, 0.5)
    case = Case(4, 1e5, stamp, latency, 0 * stamp, 20.0, 400, 40, {}, 500.0)
    assert recovery(case, 10.0) == seconds
    assert _recovery([case], replace(QUICK, window_s=10.0)).kept


@pytest.mark.parametrize("end", [5.0, 15.0])  # s of latency
def test_who_never_recovers_has_no_calm_to_be_measured_by(end):
    stamp = np.arange(40.0)
    latency = np.interp(stamp, [20.0, 39.0], [5.0, end])
    case = Case(4, 1e5, stamp, latency, 0 * stamp, 20.0, 400, 40, {}, 500.0)
    assert recovery(case, 10.0) == 0.0
    assert not _recovery([case], replace(QUICK, window_s=10.0)).kept


def overloaded(factor=4, peak_mb=500.0, early=9, groups=40, **counts):
    """A run of which the node said so, with an update a second, half of them calm."""
    stamp = np.arange(40.0)
    told = {
        "clouds received": 400,
        "clouds lost by DDS": 0,
        "updates": 30,
        "updates coalesced": 10,
    }
    told |= {"updates dropped": 0, "points evicted": early}
    said = {name: f"{count}" for name, count in (told | counts).items()}
    return Case(factor, 1e5, stamp, 0 * stamp, 0 * stamp, 20.0, 400, groups, said, peak_mb)


@pytest.mark.parametrize(
    ("second", "holds", "in_limits"),
    [
        ({}, True, True),
        ({"peak_mb": 590.0}, True, True),
        ({"peak_mb": 610.0}, True, False),
        ({"peak_mb": 590.0, "early": 0}, False, True),  # only one is at the bound
    ],
)
def test_that_memory_is_bounded_is_shown_by_two_that_reach_the_bound(second, holds, in_limits):
    row = _bound([overloaded(), overloaded(8, **second)], QUICK, 1000)
    assert (row.holds, row.in_limits) == (holds, in_limits)


@pytest.mark.parametrize(
    ("early", "holds"),
    [
        ((0, 1_700_000), True),
        ((0, 1_600_001), True),
        ((0, 1_599_999), False),  # 2,000,000 were sent, of which the window has 400,000
        ((0, 0), False),
        ((9, 1_700_000), False),
    ],
)
def test_all_points_must_be_counted_that_a_window_has_no_room_for(early, holds):
    little, much = (overloaded(early=count) for count in early)
    cases = [replace(little, rate=1e5), replace(much, rate=1e5)]
    load = replace(QUICK, window_s=10.0)
    assert not _peaks(cases[:1], "", load, 2_000_000).kept  # none that is too much
    cases[0] = replace(cases[0], rate=3e4)
    assert _peaks(cases, "", load, 400_000).kept == holds


@pytest.mark.parametrize(("late", "kept"), [(1, True), (3, False)])
def test_a_message_that_is_sent_again_is_no_old_update(late, kept):
    stale = np.where(np.arange(40) < late, 4.0, 1.5)  # 3 are many in 20, but few in 40
    assert _newest([replace(overloaded(), stale=stale)]).kept == kept


@pytest.mark.parametrize(
    ("counts", "kept"),
    [
        ({}, True),
        ({"updates": 29, "updates dropped": 1}, True),
        ({"updates": 29}, False),
        ({"updates coalesced": 11}, False),
        ({"clouds received": 399}, False),
        ({"clouds received": 399, "clouds lost by DDS": 1, "updates": 29}, True),
    ],
)
def test_every_cloud_and_every_group_must_be_counted(counts, kept):
    assert _counted([overloaded(), overloaded(8, **counts)]).kept == kept


@pytest.mark.parametrize(
    ("usual", "code", "seconds", "text", "problem"),
    [
        (0, 0, 0.1, "", ""),
        (0, 0, 9.0, "", ""),  # its time is another column
        (0, 1, 0.1, "", "exit code 1"),
        (0, 0, 0.1, "Traceback (most recent call last)", "a traceback"),
        (130, 130, 0.1, "ellipseg: interrupted", ""),
        (130, 130, 0.1, "", "not once"),
        (130, 130, 0.1, "ellipseg: interrupted\n" * 2, "not once"),
        (130, 0, 0.1, "", ""),  # it was done
        (130, 0, 2.1, "", "it worked on"),
        (130, 0, 0.1, "ellipseg: interrupted", "exit code 0"),
        (130, -2, 0.1, "", "exit code -2"),
    ],
)
def test_an_ending_of_another_kind_is_a_problem(usual, code, seconds, text, problem):
    found = _problem(Program([], 1.0, usual), code, seconds, text)
    assert problem in found and bool(found) == bool(problem)


@pytest.mark.parametrize(
    ("seconds", "problem", "holds", "in_limits"),
    [(0.1, "", True, True), (2.1, "", True, False), (0.1, "a traceback", False, True)],
)
def test_every_program_must_end_in_time(monkeypatch, seconds, problem, holds, in_limits):
    module = "studies.endurance.fault_signals"
    endings = iter([Ending("the first", seconds, problem)])
    good = Ending("another", 0.1, "")
    monkeypatch.setattr(f"{module}._interrupt", lambda *_: next(endings, good))
    monkeypatch.setattr(f"{module}._handled_after", lambda _: 0.1)
    (row,) = signals(Trial(quick=True))
    assert (row.holds, row.in_limits) == (holds, in_limits)
    assert row.row()["kept"] == row.kept == (holds and in_limits)
    assert ("3 of 4" in row.figure and "the first" in row.figure) == (not row.kept)


def reports(*rows):
    """A listener to reports of clouds received, updates, updates in backlog, s under way."""
    names = ("clouds received", "updates", "updates in backlog", "current update duration [s]")
    still = dict.fromkeys(COUNTS, "0")
    told = iter(
        [
            still | {"memory [MB]": f"{k}"} | dict(zip(names, row, strict=True))
            for k, row in enumerate(rows)
        ]
    )
    return SimpleNamespace(next_report=lambda _: next(told))


def test_the_last_word_is_said_when_nothing_waits_moves_or_is_under_way():
    busy = [("9", "3", "1", "0.4"), ("9", "3", "0", "1.4"), ("9", "3", "0", "2.4")]
    done = [("9", "4", "0", "0.0")] * 3
    assert last_word(reports(*busy, *busy, *done), 99)["memory [MB]"] == "8"
    moving = [(f"{k}", "3", "0", "0.0") for k in range(9)]
    assert last_word(reports(*moving, *done), 99)["memory [MB]"] == "11"
    # One cloud was lost: the counts stand still, and the trial ends with what there is.
    assert last_word(reports(*[("8", "3", "0", "0.0")] * 9), 99)["clouds received"] == "8"
    assert last_word(reports(*busy), 3)["memory [MB]"] == "2"  # and so it does if it never ends


def test_what_a_dead_node_said_is_not_taken_for_the_words_of_a_new_one():
    dead = Heard(10.1, 1, 40, "odom", full=False, in_step=True)  # came after the start at 10 s
    first = Heard(11.0, 2, 0, "odom", full=True, in_step=True)
    witness = SimpleNamespace(drawn=[(1, True), (2, False)])
    witness.since = lambda moment: [one for one in (dead, first) if one.time > moment]
    witness.wait = lambda done, *_: done() or pytest.fail("not done")
    here = Scene([], witness, Path(), sent={1: 9.9, 2: 10.9})
    assert here.wait_for_new(10.0) == 1.0
    assert here.from_new(10.0) == [first]
    found = Restarts()
    found.judge(here, 10.0)
    assert not found.unclear and not found.left
    witness.drawn[1] = (2, True)
    first = replace(first, full=False)
    found.judge(here, 10.0)
    assert len(found.unclear) == len(found.left) == 1


def test_numbers_that_begin_anew_are_broken_and_a_message_again_is_none():
    def numbers(*told):
        heard = [Heard(1.0, 1, number, "odom", full=True, in_step=True) for number in told]
        return Scene([], SimpleNamespace(heard=heard), Path()).numbers()

    assert unbroken(numbers(3, 4, 4, 5))
    assert not unbroken(numbers(0, 1, 2, 0, 1, 2, 3)) and not unbroken(numbers(0, 2))


# --- the command -----------------------------------------------------------------------------


@pytest.fixture
def two_subjects(monkeypatch):
    def one(trial):
        trial.say("one: at it")
        return [Promise("it lasts", "for a while", f"{trial.seed}", True)]

    def other(trial):
        return [Promise("it holds", "hard", "9", not trial.quick)]

    monkeypatch.setattr(
        subjects, "SUBJECTS", table := {"one": ("The one", one), "other": ("The other", other)}
    )
    monkeypatch.setattr("studies.endurance.__main__.SUBJECTS", table)
    monkeypatch.setattr("studies.endurance.page.SUBJECTS", table)


def test_a_broken_promise_is_shown_and_is_exit_code_1(two_subjects, capsys):
    assert main(["soak"]) == 0
    assert main(["soak", "--quick"]) == 1
    out = capsys.readouterr().out
    assert "## The one" in out and "| **no** |" in out and "In the short version" in out
    assert main(["soak", "one", "--quick", "--json"]) == 0
    assert list(json.loads(capsys.readouterr().out)) == ["one"]


def test_results_of_other_subjects_are_kept(two_subjects, tmp_path, capsys):
    assert main(["soak", "-o", str(tmp_path), "-q"]) == 0
    assert main(["soak", "one", "--seed", "7", "-o", str(tmp_path), "-q"]) == 0
    found = json.loads((tmp_path / "reliability.json").read_text())
    assert found["one"]["promises"][0]["figure"] == "7" and found["other"]["seed"] == 0
    page = (tmp_path / "reliability.md").read_text()
    assert page.index("## The one") < page.index("## The other")


def test_a_trial_that_breaks_off_is_a_broken_promise(two_subjects, monkeypatch, tmp_path, capsys):
    def broken(trial):
        raise EllipsegError("the node ended too early, with -11")

    assert main(["soak", "-o", str(tmp_path), "-q"]) == 0
    monkeypatch.setitem(subjects.SUBJECTS, "one", ("The one", broken))
    assert main(["soak", "-o", str(tmp_path), "-q"]) == 1
    page = (tmp_path / "reliability.md").read_text()
    assert "it lasts" not in page and "it holds" in page
    assert "the node ended too early, with -11" in page and "| **no** |" in page


def test_what_is_wrong_is_one_line(two_subjects, tmp_path, capsys):
    assert main(["soak", "third"]) == 2
    assert capsys.readouterr().err == "ellipseg: there is no subject third; there are one, other\n"
    (tmp_path / "reliability.json").write_text("[1]")
    assert main(["soak", "one", "-o", str(tmp_path)]) == 2
    assert "holds no results of `ellipseg soak`; remove it" in capsys.readouterr().err
