"""Scores of an association: right and wrong pairs, the error of the transform, the page."""

from dataclasses import replace

import numpy as np
import pytest
import worlds

from ellipseg_ros.association.landmark_map import select_landmarks
from ellipseg_ros.errors import InputError
from ellipseg_ros.records import SECOND, Sweep
from studies.landmarks.recognition import (
    BUDGET,
    DRIFTS,
    Sets,
    correct,
    in_common,
    of_budget,
    recognition,
    recognitions,
    things,
)
from studies.landmarks.recognition_page import HEAD, cells, recording_blocks
from studies.landmarks.recording import windows


def sets(seed=0):
    """Two observations of a world, in one frame; the things are numbered."""
    rng = np.random.default_rng(seed)
    looks = worlds.observe_twice(worlds.world(rng, lines=40), rng, 0.0, 0.0)
    number = np.arange(len(looks.later))
    earlier = np.full(len(looks.earlier), 1000) + np.arange(len(looks.earlier))
    earlier[looks.correspondences[:, 0]] = number[looks.correspondences[:, 1]]
    return Sets(looks.earlier, looks.later, whole(earlier), whole(number)), len(
        looks.correspondences
    )


def whole(numbers):
    """Landmarks that are of one thing each."""
    return [{int(number): 1.0} for number in numbers]


@pytest.mark.parametrize("drift", DRIFTS.values())
def test_what_is_right_counts_as_right(drift):
    both, there = sets()
    found = recognition(both, drift, 1, honest=True)
    assert found["right"] == found["pairs"] >= 0.95 * there
    assert found["verdict"] in ("KNOWN", "PARTIAL")
    assert found["offset"] < 0.1 and found["angle"] < 0.3


def test_a_pair_of_two_things_counts_as_wrong():
    both, _ = sets()
    others = [{thing + 5000: 1.0 for thing in shares} for shares in both.things_later]
    found = recognition(both._replace(things_later=others), (0.5, 3.0), 1, True)
    assert found["pairs"] > 20 and found["right"] == 0
    unknown = recognition(both._replace(things_later=[{}] * len(others)), (0.5, 3.0), 1, True)
    assert unknown["right"] == unknown["pairs"] == found["pairs"]


@pytest.mark.parametrize(("row", "limit"), [(0, 0.15), (12, 0.3), (40, 0.9)])
def test_a_pair_that_lies_apart_counts_as_wrong(row, limit):
    world = worlds.world(np.random.default_rng(1))
    axis = world.axes[row][:, 2]  # determined, whatever the kind
    for offset, right in ((0.9 * limit, True), (1.1 * limit, False)):
        other = replace(world, position=world.position + offset * axis)
        assert correct(world, other, np.array([row, row])) is right


def test_things_are_shares_of_the_points():
    fields = np.zeros(7, [("instance", np.uint32)])
    fields["instance"] = [4, 4, 9, 9, 9, 2, 2]
    sweep = Sweep(0, np.zeros((7, 3)), fields=fields)
    world = select_landmarks(worlds.world(np.random.default_rng(1)), [0, 1, 2])
    world = replace(world, point_labels=np.array([0, 0, 0, 1, -1, -1, 1]))
    assert things(world, sweep) == [{4: 2 / 3, 9: 1 / 3}, {9: 0.5, 2: 0.5}, {}]
    assert things(world, replace(sweep, fields=None)) == [{}, {}, {}]
    assert in_common({4: 0.6, 9: 0.4}, {9: 0.7, 4: 0.3}) == pytest.approx(0.7)
    assert in_common({4: 1.0}, {9: 1.0}) == 0.0
    assert in_common({}, {9: 1.0}) == 1.0


def test_of_too_many_those_of_the_most_points_are_taken():
    world = worlds.world(np.random.default_rng(1), lines=600)
    count = np.arange(len(world))[::-1].copy()
    assert of_budget(replace(world, count=count)).tolist() == list(range(BUDGET))


def test_windows_of_a_recording_have_nothing_in_common():
    stamps = np.arange(110) * SECOND // 10
    source = [Sweep(int(t), np.full((2, 3), t / SECOND)) for t in stamps]
    for apart, first in ((2.0, 3.0), (5.0, 5.0), (8.0, 8.0)):
        passes = windows(source, apart)
        earlier, later = passes.earlier.sweep.points[:, 0], passes.later.sweep.points[:, 0]
        assert (earlier.min(), earlier.max()) == (0.0, 2.9)
        assert later.min() == first and later.max() == pytest.approx(min(10.9, apart + 2.9))
    with pytest.raises(InputError, match=r"takes 1\.9 s"):
        windows(source[:20], 5.0)


def test_the_page_shows_the_sums_of_the_runs():
    both, _ = sets()
    found = recognitions(both, 1, honest=True)
    run = {"apart": 2.0, "method": "landmarks", "association": found}
    drift = next(iter(DRIFTS))
    shown = dict(zip(HEAD, cells([run, run], drift), strict=True))
    assert shown["precision"] == "1.000" and shown["told"] == "2/2"
    blocks = "\n".join(recording_blocks([run]))
    assert "2 s | landmarks" in blocks and found[drift]["verdict"] in blocks
    assert cells([], drift)[0] == "-"
