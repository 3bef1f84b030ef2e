"""Odd clouds, garbage and a large cloud to a node in a process of its own, over DDS."""

from dataclasses import replace

import pytest

from studies.endurance.clouds import large_cloud, serialized
from studies.endurance.conversion import Tally
from studies.endurance.inputs import QUICK, differences, inputs, of_node
from studies.endurance.live_inputs import garbage, listen
from studies.endurance.promises import Trial


@pytest.fixture(scope="module")
def heard():
    return listen(seed=3, cases=30, large=20_000)


def test_the_node_counts_every_odd_cloud_and_lives_on(heard):
    assert differences(heard) == []
    assert heard.tally.rejected.total() > 3 and heard.tally.updates > 3
    assert heard.garbage == len(garbage(serialized(large_cloud(9)))) and heard.after_garbage >= 1
    assert heard.large["points segmented"] == "20000"
    assert all(row.kept for row in of_node(heard, replace(QUICK, large=20_000)))


def test_another_count_or_too_little_breaks_the_promise(heard, monkeypatch):
    other = replace(heard, said=heard.said | {"clouds rejected: name": "999"})
    assert any("clouds rejected: name" in told for told in differences(other))
    assert not of_node(other, QUICK)[0].kept
    assert not of_node(replace(heard, after_garbage=0), QUICK)[1].kept

    module = "studies.endurance.inputs"
    monkeypatch.setattr(f"{module}.listen", lambda *_: heard)
    monkeypatch.setattr(f"{module}.QUICK", replace(QUICK, converted=1, landmarks=1, segments=1))
    rows = inputs(Trial(quick=True))
    assert not rows[0].kept  # nothing was shown by one cloud
    assert Tally().accepted == 0
