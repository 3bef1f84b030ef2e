"""The trial with a flood of calls, short, and what it would say of a node that starves."""

from dataclasses import replace

from ellipseg_ros.reliability.strangers import Case, _answers, _goes_on, drive

QUIET = Case(updates=8, expected=7, lost=0, latency=0.2)
FLOODED = replace(QUIET, latency=0.9, answers={"set_parameters": [800, 0]})


def test_a_flood_is_answered_and_the_node_goes_on():
    found = drive(["set_parameters", "reset", "tune"], 3.0, seed=1)
    assert found.updates >= found.expected and not found.lost
    assert found.answers.keys() == {"set_parameters", "reset", "tune"}
    assert all(answered > 10 for answered, _ in found.answers.values())
    assert found.answers["set_parameters"][1] == 0
    assert found.answers["reset"][1] > 10
    assert found.answers["tune"][1] < found.answers["tune"][0]


def test_a_node_that_starves_breaks_the_promise():
    for broken in (
        replace(FLOODED, latency=1.1),
        replace(FLOODED, lost=1),
        replace(FLOODED, updates=6),
    ):
        assert _goes_on(QUIET, {"parameters": FLOODED}, "").kept
        assert not _goes_on(QUIET, {"parameters": broken}, "").kept


def test_calls_without_an_answer_break_the_promise():
    floods = {"parameters": FLOODED, "~/tune": replace(QUIET, answers={"tune": [9, 1]})}
    assert _answers(floods, 1.0, "").kept
    for name, answers in (
        ("~/tune", {}),
        ("~/tune", {"tune": [0, 0]}),
        ("parameters", {"set_parameters": [9, 1]}),  # one that had to be refused
    ):
        broken = floods | {name: replace(QUIET, answers=answers)}
        assert not _answers(broken, 1.0, "").kept
