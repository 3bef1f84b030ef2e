"""Endless drive, comparison with batch, and the command; requirements that fail are reported."""

import json
from collections import deque
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from ellipseg_ros.config import Config
from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.io.bag import node_types
from ellipseg_ros.io.messages import write_segments
from ellipseg_ros.io.pointcloud2 import labelled_fields
from ellipseg_ros.io.topics import SEGMENTS
from ellipseg_ros.records import SECOND
from ellipseg_ros.segmenter import Segmenter
from studies.endurance import subjects
from studies.endurance.__main__ import main
from studies.endurance.endless_drive import EndlessDrive
from studies.endurance.endurance import endurance, equal_segments
from studies.endurance.idle_report import COUNTS, idle_report
from studies.endurance.requirements import Options, Requirement
from studies.endurance.subjects import Subject
from studies.memory import state_bytes


def test_an_endless_drive_continues_in_time_and_place_with_new_noise():
    drive = EndlessDrive(1.0, 3)
    sweeps = list(drive)
    assert len(sweeps) == len(drive) == 30
    assert set(np.diff([sweep.stamp_ns for sweep in sweeps])) == {SECOND // 10}
    first, second = sweeps[4], sweeps[14]
    moved = second.points - first.points
    assert np.hypot(*np.median(moved, axis=0)[:2]) > 1.0
    assert 0.012 < np.std(moved[:, 0]) < 0.016  # sqrt(2) times 1 cm
    for name, column in zip("xyz", second.points.T, strict=True):
        assert np.array_equal(second.fields[name], column)
    again = list(replace(drive, first=2, laps=1))
    assert all(np.array_equal(a.points, b.points) for a, b in zip(sweeps[20:], again, strict=True))


@pytest.mark.parametrize("rate", [1000.0, 30_000.0])
def test_an_endless_drive_has_the_requested_rate(rate):
    points = sum(map(len, EndlessDrive(2.0, 1, rate)))
    assert points / 2.0 == pytest.approx(rate, rel=0.05)


def test_the_size_of_a_state_is_that_of_its_arrays_and_containers():
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


# --- equality with batch ---------------------------------------------------------------------


@pytest.fixture(scope="module")
def batch():
    segmenter = Segmenter(Config(window_duration=1.0))
    return segmenter.process(next(iter(EndlessDrive(0.5, 1))))


def published(update):
    """The SegmentArray and the point fields of an update."""
    data = write_segments(update)
    return node_types().deserialize_cdr(data, SEGMENTS.type), labelled_fields(update)


def test_an_update_with_other_ids_equals_batch(batch):
    message, fields = published(replace(batch, ids=batch.ids[::-1] + np.uint32(100)))
    assert equal_segments(batch, message, fields)


def _swap_label(message, fields):
    label = fields["label"]
    label[label == message.segments[0].id] = message.segments[1].id


@pytest.mark.parametrize(
    "change",
    [
        lambda message, fields: setattr(message.segments[3], "covariance", np.ones(9)),
        lambda message, fields: setattr(message.segments[0], "count", 1),
        lambda message, fields: setattr(message.segments[0], "aicc", 1.0),
        lambda message, fields: setattr(message, "aicc", np.nextafter(message.aicc, 0.0)),
        lambda message, fields: message.segments.pop(),
        lambda message, fields: fields["label"].__setitem__(slice(0, 5), 0),
        lambda message, fields: fields["x"].__setitem__(7, 0.0),
        _swap_label,
    ],
)
def test_an_update_with_any_other_difference_does_not_equal_batch(batch, change):
    message, fields = published(batch)
    change(message, fields)
    assert not equal_segments(batch, message, fields)


# --- a node that is idle ---------------------------------------------------------------------


def reports(*rows):
    """Diagnostics of clouds received, updates, updates in backlog, and s of the running update."""
    names = ("clouds received", "updates", "updates in backlog", "current update duration [s]")
    constant = dict.fromkeys(COUNTS, "0")
    values = iter(
        [
            constant | {"memory [MB]": f"{k}"} | dict(zip(names, row, strict=True))
            for k, row in enumerate(rows)
        ]
    )
    return SimpleNamespace(next_report=lambda _: next(values))


BUSY = [("9", "3", "1", "0.4"), ("9", "3", "0", "1.4"), ("9", "3", "0", "2.4")]
IDLE = [("9", "4", "0", "0.0")] * 3


def test_a_node_is_idle_when_nothing_waits_changes_or_runs():
    assert idle_report(reports(*BUSY, *BUSY, *IDLE), 99)["memory [MB]"] == "8"
    changing = [(f"{k}", "3", "0", "0.0") for k in range(9)]
    assert idle_report(reports(*changing, *IDLE), 99)["memory [MB]"] == "11"


def test_a_node_that_lost_a_cloud_becomes_idle_too():
    assert idle_report(reports(*[("8", "3", "0", "0.0")] * 9), 99)["clouds received"] == "8"


def test_waiting_for_an_idle_node_is_bounded():
    assert idle_report(reports(*BUSY), 3)["memory [MB]"] == "2"


# --- the subject with a real node ------------------------------------------------------------


def test_requirements_of_the_endurance_subject_hold():
    """Limits of time and memory are for the full version: other tests run meanwhile."""
    assert not [row for row in endurance(Options(quick=True)) if not row.holds]


# --- the command -----------------------------------------------------------------------------


@pytest.fixture
def two_subjects(monkeypatch):
    def first(options):
        options.log("first: running")
        return [Requirement("it lasts", "for a while", f"{options.seed}", True)]

    def second(options):
        return [Requirement("it holds", "hard", "9", not options.quick)]

    for name in list(subjects.SUBJECTS):
        monkeypatch.delitem(subjects.SUBJECTS, name)
    monkeypatch.setitem(subjects.SUBJECTS, "first", Subject("The first", first))
    monkeypatch.setitem(subjects.SUBJECTS, "second", Subject("The second", second))


def test_an_unmet_requirement_is_shown_and_is_exit_code_1(two_subjects, capsys):
    assert main([]) == 0
    assert main(["--quick"]) == 1
    out = capsys.readouterr().out
    assert "## The first" in out and "| **not met** |" in out and "Short version, " in out
    assert main(["first", "--quick", "--json"]) == 0
    assert list(json.loads(capsys.readouterr().out)) == ["first"]


def test_results_of_other_subjects_are_kept(two_subjects, tmp_path):
    assert main(["-o", str(tmp_path), "-q"]) == 0
    assert main(["first", "--seed", "7", "-o", str(tmp_path), "-q"]) == 0
    results = json.loads((tmp_path / "endurance.json").read_text())
    assert results["first"]["requirements"][0]["measured"] == "7"
    assert results["second"]["seed"] == 0
    page = (tmp_path / "endurance.md").read_text()
    assert page.index("## The first") < page.index("## The second")


def test_an_error_in_a_subject_is_an_unmet_requirement(two_subjects, monkeypatch, tmp_path):
    def broken(options):
        raise EllipsegError("the node ended too early, with -11")

    assert main(["-o", str(tmp_path), "-q"]) == 0
    monkeypatch.setitem(subjects.SUBJECTS, "first", Subject("The first", broken))
    assert main(["-o", str(tmp_path), "-q"]) == 1
    page = (tmp_path / "endurance.md").read_text()
    assert "it lasts" not in page and "it holds" in page
    assert "the node ended too early, with -11" in page and "| **not met** |" in page


def test_a_requirement_beyond_its_limits_is_not_met():
    row = Requirement("it is fast", "once", "2 s", True, within_limits=False)
    assert row.holds and not row.met and row.row()["result"] == "not met"


def test_a_wrong_subject_or_file_is_an_error_of_one_line(two_subjects, tmp_path, capsys):
    assert main(["third"]) == 2
    error = capsys.readouterr().err
    assert error == "studies.endurance: there is no subject third; there are first, second\n"
    (tmp_path / "endurance.json").write_text("[1]")
    assert main(["first", "-o", str(tmp_path)]) == 2
    assert "holds no results of studies.endurance; remove it" in capsys.readouterr().err
