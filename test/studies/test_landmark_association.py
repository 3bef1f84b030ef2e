"""Scores of an association: correct and wrong pairs, error of the transform, sections."""

from dataclasses import replace

import numpy as np
import pytest
import worlds

from ellipseg_ros.association.landmark_map import select_landmarks
from ellipseg_ros.errors import InputError
from ellipseg_ros.records import SECOND, Sweep
from studies.landmarks.association import (
    DRIFTS,
    MAX_LANDMARKS,
    LandmarkSets,
    all_scores,
    association_scores,
    common_share,
    instance_shares,
    is_close,
    largest,
)
from studies.landmarks.association_page import HEAD, cells, recording_sections
from studies.landmarks.page import mean_and_range
from studies.landmarks.recording import windows


@pytest.fixture(scope="module")
def observed():
    """Two observations of a world in one frame, with the number of common landmarks."""
    rng = np.random.default_rng(0)
    both = worlds.observe_twice(worlds.world(rng, lines=40), rng, 0.0, 0.0)
    later = np.arange(len(both.later))
    earlier = 1000 + np.arange(len(both.earlier))
    earlier[both.correspondences[:, 0]] = later[both.correspondences[:, 1]]
    sets = LandmarkSets(
        both.earlier, both.later, single_instances(earlier), single_instances(later)
    )
    return sets, len(both.correspondences)


def single_instances(numbers):
    """Shares of landmarks that belong to one instance each."""
    return [{int(number): 1.0} for number in numbers]


@pytest.mark.parametrize("drift", DRIFTS.values())
def test_pairs_of_the_same_instances_are_correct(observed, drift):
    sets, common = observed
    scores = association_scores(sets, drift, 1, has_covariance=True)
    assert scores["correct"] == scores["pairs"] >= 0.95 * common
    assert scores["verdict"] in ("KNOWN", "PARTIAL")
    assert scores["error_m"] < 0.1 and scores["error_deg"] < 0.3


def test_pairs_of_different_instances_are_wrong(observed):
    sets, _ = observed
    others = [{number + 5000: 1.0 for number in shares} for shares in sets.instances_later]
    scores = association_scores(sets._replace(instances_later=others), (0.5, 3.0), 1, True)
    assert scores["pairs"] > 20 and scores["correct"] == 0
    unknown = sets._replace(instances_later=[{}] * len(others))
    without_truth = association_scores(unknown, (0.5, 3.0), 1, True)
    assert without_truth["correct"] == without_truth["pairs"] == scores["pairs"]


@pytest.mark.parametrize(("row", "limit"), [(0, 0.15), (12, 0.3), (40, 0.9)])
def test_a_distant_pair_is_wrong(row, limit):
    world = worlds.world(np.random.default_rng(1))
    axis = world.axes[row][:, 2]  # determined for every kind
    for offset, correct in ((0.9 * limit, True), (1.1 * limit, False)):
        other = replace(world, position=world.position + offset * axis)
        assert is_close(world, other, np.array([row, row])) is correct


def test_instances_are_shares_of_the_points():
    fields = np.zeros(7, [("instance", np.uint32)])
    fields["instance"] = [4, 4, 9, 9, 9, 2, 2]
    sweep = Sweep(0, np.zeros((7, 3)), fields=fields)
    world = select_landmarks(worlds.world(np.random.default_rng(1)), [0, 1, 2])
    world = replace(world, point_labels=np.array([0, 0, 0, 1, -1, -1, 1]))
    assert instance_shares(world, sweep) == [{4: 2 / 3, 9: 1 / 3}, {9: 0.5, 2: 0.5}, {}]
    assert instance_shares(world, replace(sweep, fields=None)) == [{}, {}, {}]


def test_common_shares_of_instances():
    assert common_share({4: 0.6, 9: 0.4}, {9: 0.7, 4: 0.3}) == pytest.approx(0.7)
    assert common_share({4: 1.0}, {9: 1.0}) == 0.0
    assert common_share({}, {9: 1.0}) == 1.0


def test_of_too_many_landmarks_those_with_the_most_points_are_used():
    world = worlds.world(np.random.default_rng(1), lines=600)
    count = np.arange(len(world))[::-1].copy()
    assert largest(replace(world, count=count)).tolist() == list(range(MAX_LANDMARKS))


def test_windows_of_a_recording_have_no_sweep_in_common():
    stamps = np.arange(110) * SECOND // 10
    source = [Sweep(int(t), np.full((2, 3), t / SECOND)) for t in stamps]
    for delay, first in ((2.0, 3.0), (5.0, 5.0), (8.0, 8.0)):
        passes = windows(source, delay)
        earlier, later = passes.earlier.sweep.points[:, 0], passes.later.sweep.points[:, 0]
        assert (earlier.min(), earlier.max()) == (0.0, 2.9)
        assert later.min() == first and later.max() == pytest.approx(min(10.9, delay + 2.9))
    with pytest.raises(InputError, match=r"takes 1\.9 s"):
        windows(source[:20], 5.0)


def test_the_page_shows_sums_over_runs(observed):
    scores = all_scores(observed[0], 1, has_covariance=True)
    run = {"delay_s": 2.0, "method": "landmarks", "association": scores}
    drift = next(iter(DRIFTS))
    shown = dict(zip(HEAD, cells([run, run], drift), strict=True))
    assert shown["precision"] == "1.000" and shown["with transform"] == "2/2"
    text = "\n".join(block for part in recording_sections([run]) for block in part.blocks())
    assert "2 s | landmarks" in text and scores[drift]["verdict"] in text


def test_without_runs_the_page_shows_dashes():
    assert cells([], next(iter(DRIFTS)))[0] == "-"
    assert mean_and_range([]) == "-"
