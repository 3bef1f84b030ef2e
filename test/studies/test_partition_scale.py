"""What is said of scales is what runs at those scales, and plain counting, give."""

import json
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.image import imread

from ellipseg_ros.cli.main import main
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
from studies.partition.scale import (
    DOUBLING,
    PAIRS,
    diagonal,
    in_both,
    moved,
    regrouped,
    rows,
    scales,
    study_scene,
)
from studies.partition.scale_page import page
from studies.partition.scale_picture import draw

CONFIG = Config(update_period=0.3, window_duration=0.6)


def drive():
    return list(simulate("roadway", duration=1.5))


@pytest.fixture(scope="module")
def windows():
    segmenter = Segmenter(CONFIG)
    return [segmenter.process(group) for group in updates(drive(), CONFIG)]


def partition(size, rng):
    """Labels 0 to `size` - 1 of 200 points, all of them used, ascending by first point."""
    labels = np.concatenate([np.arange(size), rng.integers(0, size, 200 - size)])
    _, first, labels = np.unique(rng.permutation(labels), return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[labels].astype(np.int32)


@pytest.mark.parametrize("seed", range(5))
def test_overlaps_of_groups_are_those_of_their_points(seed):
    rng = np.random.default_rng(seed)
    ours, theirs = partition(20, rng), 3 + partition(15, rng)
    one, other = rng.integers(0, 6, 20), rng.integers(0, 4, 18)
    for groups, labels in ((other, other[theirs]), (None, theirs)):
        found = regrouped(overlaps(ours, theirs), one, groups)
        expected = overlaps(one[ours], labels)
        for name in ("ours", "truth", "count", "our_values", "true_values"):
            assert np.array_equal(getattr(found, name), getattr(expected, name)), name


@pytest.mark.parametrize("seed", range(20))
def test_what_moved_are_the_points_whose_id_changes(seed):
    rng = np.random.default_rng(seed)
    labels = [partition(int(rng.integers(1, 40)), rng) for _ in range(2)]
    tracker = Tracker()
    ids = []
    for one in labels:
        facts = np.bincount(one)[:, None].astype(float)
        ids.append(tracker.assign(np.arange(200), one, facts).ids[one])
    assert moved(overlaps(*labels)) == pytest.approx(np.mean(ids[0] != ids[1]))
    assert moved(overlaps(labels[0], labels[0])) == 0.0


def test_the_share_in_the_heir_by_hand():
    # Two objects of 5 and 3 points become one: the 3 move. A third, of 4, falls into 2 and 2.
    before = np.repeat([0, 1, 2], [5, 3, 4])
    after = np.repeat([0, 0, 1, 2], [5, 3, 2, 2])
    assert moved(overlaps(before, after)) == pytest.approx(5 / 12)
    counts = diagonal(np.array([5, 3, 4]))
    assert moved(regrouped(counts, np.array([0, 1, 2]), np.array([0, 0, 0]))) == pytest.approx(
        7 / 12
    )
    assert moved(overlaps(before[:0], after[:0])) == 0.0


def test_a_row_is_what_a_run_at_its_scale_gives(windows):
    scale = 2.0
    (found,) = rows(windows[-3:], [scale])
    configs = [replace(CONFIG, objects=ObjectsConfig(scale=s)) for s in (scale, 2 * scale)]
    at, wider = (
        [segmenter.process(group) for group in updates(drive(), CONFIG)]
        for segmenter in map(Segmenter, configs)
    )
    last = at[-1]
    labels = last.objects.segment_labels[last.labels]
    has = last.labels >= 0
    assert found["objects"] == len(last.objects)
    shared = overlaps(labels[has], wider[-1].objects.segment_labels[last.labels][has])
    assert found["ari_wider"] == pytest.approx(adjusted_rand_index(shared))
    assert found["moved_wider"] == pytest.approx(moved(shared))
    things, classes = last.fields["instance"], last.fields["class"]
    known = has & (classes > 0)
    expected = score_instances(labels, things, known)
    assert found["ari"] == pytest.approx(expected.ari)
    assert found["quality"] == pytest.approx(expected.quality)
    assert found["purity"] == pytest.approx(purity(overlaps(labels[known], classes[known])))
    paid = last.objects.hierarchy.cost
    merges = last.objects.hierarchy.merges_up_to(scale)
    assert found["paid"] == pytest.approx(paid[:merges].sum() / paid.sum())

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
        assert in_both(one, other).count.sum() == len(pairs)
        agreement.append(adjusted_rand_index(both))
        changed.append(moved(both))
    assert found["ari_next"] == pytest.approx(np.mean(agreement))
    assert found["moved_next"] == pytest.approx(np.mean(changed))


def test_objects_become_fewer_and_the_cost_that_is_paid_grows_with_the_scale(windows):
    found = rows(windows[-1:], scales(1.0))
    counts = [row["objects"] for row in found]
    paid = [row["paid"] for row in found]
    assert counts == sorted(counts, reverse=True) and counts[0] > counts[-1]
    assert paid == sorted(paid) and 0.0 <= paid[0] < paid[-1] <= 1.0
    assert found[0]["ari_next"] is None  # a single window


def test_a_single_cloud_has_no_next_update_and_perhaps_no_truth(tmp_path):
    points = np.random.default_rng(0).uniform(0.0, [4.0, 2.0, 0.1], (900, 3))
    found = study_scene([Sweep(0, points)], Config())
    assert found["pairs"] == 0 and found["ungrouped"] == {}
    assert "mean_iou" not in found["rows"][0]
    scene = {"name": "cloud", "simulated": False} | found
    results = {"scale": Config().objects.scale, "settings": {}, "scenes": [scene]}
    assert "| -" in page(results) and "nan" not in page(results)
    draw(results, tmp_path / "scale.png")
    with pytest.raises(EllipsegError, match="no segments"):
        study_scene([Sweep(0, points[:1])], Config())


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scale")
    scenes = ["sim:roadway", "sim:mixed", "--duration", "3", "--set", "max_lateness=2"]
    assert main(["evaluate", "scale", *scenes, "-q", "-o", str(folder)]) == 0
    return folder


def test_the_command_writes_page_numbers_and_picture(written):
    results = json.loads((written / "scale.json").read_text())
    assert [scene["name"] for scene in results["scenes"]] == ["roadway", "mixed"]
    own = ObjectsConfig().scale
    assert results["scale"] == own
    for scene in results["scenes"]:
        middle = scene["rows"][len(scene["rows"]) // 2]
        assert middle["scale"] == own
        assert scene["pairs"] == 2 < PAIRS
    text = (written / "scale.md").read_text()
    assert "Settings: max_lateness 2.0." in text
    assert text.count(f"| **{own:g}**") == 2 and "## mixed" in text
    table = text.split("## roadway")[1].split("##")[0]
    assert table.count("\n| ") == 2 + 1 + len(scales(own)) // DOUBLING  # a head and its rule
    picture = imread(written / "scale.png")
    assert picture.shape == (1100, 1900, 4) and picture[..., :3].std() > 0.05


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["sim:roadway", "--set", "objects.scale=0"], "objects.scale is 0; it must be above 0"),
        (["sim:moon"], "there is no scene 'moon'"),
        (["sim:roadway", "missing.npz", "--seed", "1"], "--seed is for simulated scenes"),
    ],
)
def test_what_cannot_be_is_one_line(words, complaint, capsys):
    assert main(["evaluate", "scale", *words, "-q"]) == 2
    said = capsys.readouterr().err
    assert complaint in said and said.count("\n") == 1
