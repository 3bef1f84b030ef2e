"""Measures of an object scale equal those of a run at that scale, and of plain counting."""

import json
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.image import imread

from ellipseg_ros.config import Config, ObjectsConfig
from ellipseg_ros.core.tracking import Tracker
from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.node.grouping import updates
from ellipseg_ros.records import Sweep
from ellipseg_ros.segmenter import Segmenter
from ellipseg_ros.simulation.simulator import simulate
from studies.partition.metrics import (
    adjusted_rand_index,
    overlaps,
    purity,
    score_instances,
)
from studies.partition.scale.__main__ import main
from studies.partition.scale.chart import draw
from studies.partition.scale.cuts import (
    DOUBLING,
    MAX_PAIRS,
    identical,
    moved,
    regrouped,
    rows,
    scales,
    shared_points,
    study_scene,
)
from studies.partition.scale.page import page

CONFIG = Config(update_period=0.3, window_duration=0.6)


def drive():
    return list(simulate("roadway", duration=1.5))


@pytest.fixture(scope="module")
def windows():
    segmenter = Segmenter(CONFIG)
    return [segmenter.process(group) for group in updates(drive(), CONFIG)]


def partition(size, rng):
    """Labels of 200 points: 0 to `size` - 1, ascending by first point."""
    labels = np.concatenate([np.arange(size), rng.integers(0, size, 200 - size)])
    _, first, labels = np.unique(rng.permutation(labels), return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[labels].astype(np.int32)


@pytest.mark.parametrize("seed", range(5))
def test_overlaps_of_groups_equal_those_of_their_points(seed):
    rng = np.random.default_rng(seed)
    ours, theirs = partition(20, rng), 3 + partition(15, rng)
    one, other = rng.integers(0, 6, 20), rng.integers(0, 4, 18)
    for groups, labels in ((other, other[theirs]), (None, theirs)):
        regrouped_overlaps = regrouped(overlaps(ours, theirs), one, groups)
        expected = overlaps(one[ours], labels)
        for name in ("ours", "truth", "count", "our_values", "true_values"):
            assert np.array_equal(getattr(regrouped_overlaps, name), getattr(expected, name)), name


@pytest.mark.parametrize("seed", range(20))
def test_points_that_moved_are_those_whose_id_changes(seed):
    rng = np.random.default_rng(seed)
    labels = [partition(int(rng.integers(1, 40)), rng) for _ in range(2)]
    tracker = Tracker()
    ids = []
    for one in labels:
        facts = np.bincount(one)[:, None].astype(float)
        ids.append(tracker.assign(np.arange(200), one, facts).ids[one])
    assert moved(overlaps(*labels)) == pytest.approx(np.mean(ids[0] != ids[1]))
    assert moved(overlaps(labels[0], labels[0])) == 0.0


def test_the_share_outside_the_successor_by_hand():
    # Two objects of 5 and 3 points become one: the 3 move. A third, of 4, falls into 2 and 2.
    before = np.repeat([0, 1, 2], [5, 3, 4])
    after = np.repeat([0, 0, 1, 2], [5, 3, 2, 2])
    assert moved(overlaps(before, after)) == pytest.approx(5 / 12)
    counts = identical(np.array([5, 3, 4]))
    assert moved(regrouped(counts, np.array([0, 1, 2]), np.array([0, 0, 0]))) == pytest.approx(
        7 / 12
    )
    assert moved(overlaps(before[:0], after[:0])) == 0.0


def test_a_row_equals_a_run_at_its_scale(windows):
    scale = 2.0
    (row,) = rows(windows[-3:], [scale])
    configs = [replace(CONFIG, objects=ObjectsConfig(scale=s)) for s in (scale, 2 * scale)]
    at, doubled = (
        [segmenter.process(group) for group in updates(drive(), CONFIG)]
        for segmenter in map(Segmenter, configs)
    )
    last = at[-1]
    labels = last.objects.segment_labels[last.labels]
    has = last.labels >= 0
    assert row["objects"] == len(last.objects)
    shared = overlaps(labels[has], doubled[-1].objects.segment_labels[last.labels][has])
    assert row["ari_doubled"] == pytest.approx(adjusted_rand_index(shared))
    assert row["moved_doubled"] == pytest.approx(moved(shared))
    things, classes = last.fields["instance"], last.fields["class"]
    known = has & (classes > 0)
    expected = score_instances(labels, things, known)
    assert row["ari"] == pytest.approx(expected.ari)
    assert row["quality"] == pytest.approx(expected.quality)
    assert row["purity"] == pytest.approx(purity(overlaps(labels[known], classes[known])))
    cost = last.objects.hierarchy.cost
    merges = last.objects.hierarchy.merges_up_to(scale)
    assert row["cost_share"] == pytest.approx(cost[:merges].sum() / cost.sum())

    agreement, changed = [], []
    for one, other in zip(at[-3:-1], at[-2:], strict=True):
        where = {number: k for k, number in enumerate(one.arrival)}
        pairs = [(where[number], k) for k, number in enumerate(other.arrival) if number in where]
        pairs = [(i, k) for i, k in pairs if one.labels[i] >= 0 and other.labels[k] >= 0]
        i, k = np.array(pairs).T
        both = overlaps(
            one.objects.segment_labels[one.labels[i]],
            other.objects.segment_labels[other.labels[k]],
        )
        assert shared_points(one, other).count.sum() == len(pairs)
        agreement.append(adjusted_rand_index(both))
        changed.append(moved(both))
    assert row["ari_next"] == pytest.approx(np.mean(agreement))
    assert row["moved_next"] == pytest.approx(np.mean(changed))


def test_a_larger_scale_gives_fewer_objects_at_a_higher_cost(windows):
    measured = rows(windows[-1:], scales(1.0))
    counts = [row["objects"] for row in measured]
    cost = [row["cost_share"] for row in measured]
    assert counts == sorted(counts, reverse=True) and counts[0] > counts[-1]
    assert cost == sorted(cost) and 0.0 <= cost[0] < cost[-1] <= 1.0
    assert measured[0]["ari_next"] is None  # a single window


def test_a_cloud_without_truth_is_measured(tmp_path):
    points = np.random.default_rng(0).uniform(0.0, [4.0, 2.0, 0.1], (900, 3))
    measured = study_scene([Sweep(0, points)], Config())
    assert measured["pairs"] == 0 and measured["ungrouped"] == {}
    assert "mean_iou" not in measured["rows"][0]
    scene = {"name": "cloud", "simulated": False} | measured
    results = {"scale": Config().objects.scale, "settings": {}, "scenes": [scene]}
    text = page(results).markdown()
    assert "| -" in text and "nan" not in text
    draw(results, tmp_path / "scale.png")
    with pytest.raises(EllipsegError, match="no segments"):
        study_scene([Sweep(0, points[:1])], Config())


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scale")
    scenes = ["sim:roadway", "sim:mixed", "--duration", "3", "--set", "max_lateness=2"]
    assert main([*scenes, "-q", "-o", str(folder)]) == 0
    return folder


def test_the_command_writes_page_numbers_and_chart(written):
    results = json.loads((written / "scale.json").read_text())
    assert [scene["name"] for scene in results["scenes"]] == ["roadway", "mixed"]
    own = ObjectsConfig().scale
    assert results["scale"] == own
    for scene in results["scenes"]:
        middle = scene["rows"][len(scene["rows"]) // 2]
        assert middle["scale"] == own
        assert scene["pairs"] == 2 < MAX_PAIRS
    text = (written / "scale.md").read_text()
    assert "Settings: max_lateness 2.0." in text
    assert text.count(f"| **{own:g}**") == 2 and "## mixed" in text
    table = text.split("## roadway")[1].split("##")[0]
    assert table.count("\n| ") == 2 + 1 + len(scales(own)) // DOUBLING  # a head and its rule
    picture = imread(written / "scale.png")
    assert picture.shape == (1100, 1900, 4) and picture[..., :3].std() > 0.05


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["sim:roadway", "--set", "objects.scale=0"], "objects.scale is 0; it must be above 0"),
        (["sim:moon"], "there is no scene 'moon'"),
        (["sim:roadway", "missing.npz", "--seed", "1"], "--seed applies to simulated scenes"),
    ],
)
def test_an_error_is_one_line(words, message, capsys):
    assert main([*words, "-q"]) == 2
    error = capsys.readouterr().err
    assert message in error and error.count("\n") == 1
