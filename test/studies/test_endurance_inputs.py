"""Odd clouds, garbage and a large cloud to a real node over DDS."""

from dataclasses import replace

import pytest

from studies.endurance.cloud_messages import large_cloud, serialized
from studies.endurance.conversion import Tally, convert
from studies.endurance.inputs import (
    converted_requirements,
    count_differences,
    live_requirements,
)
from studies.endurance.live_inputs import garbage, send_odd_clouds

CASES, LARGE = 30, 20_000


@pytest.fixture(scope="module")
def live():
    return send_odd_clouds(seed=3, cases=CASES, large=LARGE)


def test_the_node_counts_every_odd_cloud_and_continues(live):
    assert count_differences(live) == []
    assert live.tally.rejected.total() > 3 and live.tally.updates > 3
    assert live.garbage == len(garbage(serialized(large_cloud(9)))) and live.after_garbage >= 1
    assert live.large_report["points segmented"] == f"{LARGE}"
    assert all(row.met for row in live_requirements(live, CASES, LARGE))


def test_another_count_is_a_difference(live):
    other = replace(live, report=live.report | {"clouds rejected: name": "999"})
    assert any("clouds rejected: name" in text for text in count_differences(other))
    assert not live_requirements(other, CASES, LARGE)[0].met


def test_a_node_that_receives_nothing_after_garbage_does_not_meet_the_requirement(live):
    assert not live_requirements(replace(live, after_garbage=0), CASES, LARGE)[1].met


def test_a_large_cloud_with_other_counts_does_not_meet_the_requirement(live):
    report = live.large_report | {"points evicted": "7"}
    assert not live_requirements(replace(live, large_report=report), CASES, LARGE)[2].met


def test_one_cloud_does_not_show_that_requirements_are_met():
    assert not converted_requirements(convert(0, range(1)), 0.0)[0].met
    assert Tally().accepted == 0
