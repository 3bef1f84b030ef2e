"""Partition scores equal naive twins that count point by point, and known values."""

from collections import Counter
from itertools import combinations

import numpy as np
import pytest

from ellipseg_ros.errors import InputError
from studies.partition.metrics import (
    adjusted_rand_index,
    boundary_recall,
    overlaps,
    score_instances,
    score_partition,
)


def naive_votes(labels, classes):
    """The most frequent class of every segment; ties: the lower one."""
    votes = {}
    for segment in set(labels):
        tally = Counter(c for s, c in zip(labels, classes, strict=True) if s == segment)
        votes[segment] = min(tally, key=lambda c: (-tally[c], c))
    return votes


def naive_purity(labels, classes):
    votes = naive_votes(labels, classes)
    return np.mean([votes[s] == c for s, c in zip(labels, classes, strict=True)])


def naive_ious(labels, classes):
    votes = naive_votes(labels, classes)
    predicted = [votes[s] for s in labels]
    ious = {}
    for one in set(classes):
        both = sum(a == one and b == one for a, b in zip(predicted, classes, strict=True))
        either = sum(a == one or b == one for a, b in zip(predicted, classes, strict=True))
        ious[one] = both / either
    return ious


def naive_under_segmentation(labels, classes):
    leaks = 0
    for segment in set(labels):
        members = [c for s, c in zip(labels, classes, strict=True) if s == segment]
        for one in set(members):
            leaks += min(members.count(one), len(members) - members.count(one))
    return leaks / len(labels)


def naive_recall(predicted, reference, edges):
    """Share of the reference boundary edges that have a point of a predicted one."""
    cut = {k for edge in edges if predicted[edge[0]] != predicted[edge[1]] for k in edge}
    boundary = [(i, j) for i, j in edges if reference[i] != reference[j]]
    return np.mean([i in cut or j in cut for i, j in boundary]) if boundary else np.nan


def naive_rand(labels, truth):
    """Hubert and Arabie, over all pairs of points."""
    pairs = list(combinations(range(len(labels)), 2))
    same = [labels[i] == labels[j] for i, j in pairs]
    true = [truth[i] == truth[j] for i, j in pairs]
    both = sum(a and b for a, b in zip(same, true, strict=True))
    chance = sum(same) * sum(true) / len(pairs)
    return (both - chance) / (0.5 * (sum(same) + sum(true)) - chance)


def naive_panoptic(labels, instances):
    """(precision, recall, quality), from sets of points."""
    points = range(len(labels))
    segments = [{i for i in points if labels[i] == s} for s in sorted(set(labels))]
    things = [{i for i in points if instances[i] == t} for t in sorted(set(instances) - {0})]
    things = [thing for thing in things if len(thing) >= 12]
    ious, spare = [], 0
    for segment in segments:
        best = max((len(segment & t) / len(segment | t) for t in things), default=0.0)
        if best > 0.5:
            ious.append(best)
        elif len(segment) >= 12 and 2 * sum(len(segment & t) for t in things) > len(segment):
            spare += 1
    missed = len(things) - len(ious)
    quality = sum(ious) / (len(ious) + 0.5 * spare + 0.5 * missed)
    return len(ious) / (len(ious) + spare), len(ious) / len(things), quality


def random_case(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(30, 90))
    classes = rng.integers(0, 4, n)
    labels = np.where(rng.random(n) < 0.7, classes * 10, rng.integers(50, 58, n))
    edges = np.unique(np.sort(rng.integers(0, n, (3 * n, 2)), axis=1), axis=0)
    return labels, classes, edges[edges[:, 0] != edges[:, 1]]


@pytest.mark.parametrize("seed", range(12))
def test_partition_scores_equal_the_naive_ones(seed):
    labels, classes, edges = random_case(seed)
    known = classes > 0
    some, true = labels[known].tolist(), classes[known].tolist()
    inside = [(i, j) for i, j in edges.tolist() if known[i] and known[j]]
    found = score_partition(labels, classes, edges)
    assert found.purity == pytest.approx(naive_purity(some, true))
    assert found.iou == pytest.approx(naive_ious(some, true))
    assert found.mean_iou == pytest.approx(np.mean(list(naive_ious(some, true).values())))
    assert found.under_segmentation == pytest.approx(naive_under_segmentation(some, true))
    assert found.boundary_recall == pytest.approx(naive_recall(labels, classes, inside))
    assert found.boundary_precision == pytest.approx(naive_recall(classes, labels, inside))


@pytest.mark.parametrize("seed", range(6))
def test_the_rand_index_equals_the_naive_one(seed):
    labels, truth, _ = random_case(seed)
    expected = naive_rand(labels.tolist(), truth.tolist())
    assert adjusted_rand_index(overlaps(labels, truth)) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("labels", "truth", "index"),
    [  # those of the documentation of scikit-learn
        ([0, 0, 1, 1], [1, 1, 0, 0], 1.0),
        ([0, 0, 1, 2], [0, 0, 1, 1], 4 / 7),
        ([0, 0, 1, 1], [0, 0, 1, 2], 4 / 7),
        ([0, 0, 0, 0], [0, 1, 2, 3], 0.0),
        ([1, 1, 0, 0], [0, 0, 1, 1], 1.0),
        ([0, 1, 0, 1], [0, 0, 1, 1], -0.5),
        ([0, 1, 2], [5, 6, 7], 1.0),
        ([0], [3], 1.0),
    ],
)
def test_the_rand_index_has_known_values(labels, truth, index):
    assert adjusted_rand_index(overlaps(np.array(labels), np.array(truth))) == pytest.approx(index)


@pytest.mark.parametrize("seed", range(8))
def test_instance_scores_equal_the_naive_ones(seed):
    rng = np.random.default_rng(seed)
    instances = np.repeat(np.arange(8), rng.integers(5, 40, 8))
    labels = np.where(rng.random(len(instances)) < 0.8, instances, instances // 2 + 20)
    labels[instances == 3] = rng.integers(30, 33, (instances == 3).sum())
    known = np.ones(len(labels), dtype=bool)
    found = score_instances(labels, instances, known)
    expected = naive_panoptic(labels.tolist(), instances.tolist())
    assert (found.precision, found.recall, found.quality) == pytest.approx(expected)


def test_the_truth_has_perfect_scores():
    rng = np.random.default_rng(0)
    instances = np.repeat(np.arange(5), 20)
    classes = np.array([1, 2, 2, 3, 6])[instances]
    edges = np.sort(rng.integers(0, 100, (300, 2)), axis=1)
    found = score_partition(classes, classes, edges)
    assert (found.purity, found.mean_iou, found.under_segmentation) == (1.0, 1.0, 0.0)
    assert (found.boundary_recall, found.boundary_precision) == (1.0, 1.0)
    scores = score_instances(instances, instances, classes > 0)
    assert (scores.ari, scores.precision, scores.recall, scores.quality) == (1.0,) * 4


def test_scores_do_not_depend_on_segment_numbers():
    labels, classes, edges = random_case(3)
    other = np.unique(labels, return_inverse=True)[1] * -7 + 10**9
    assert score_partition(labels, classes, edges) == score_partition(other, classes, edges)


def test_a_boundary_may_be_off_by_one_edge():
    wanted = np.array([0] * 5 + [1] * 5)
    edges = np.column_stack([np.arange(9), np.arange(1, 10)])
    recalls = [
        boundary_recall(np.repeat([0, 1], [5 + k, 5 - k]), wanted, edges) for k in (0, 1, 2)
    ]
    assert recalls == [1.0, 1.0, 0.0]


def test_undefined_scores_are_nan():
    one = np.ones(4, np.int64)
    found = score_partition(one, one, np.array([[0, 1]]))
    assert np.isnan([found.boundary_recall, found.boundary_precision]).all()
    ground = score_instances(one, np.zeros(4, np.int64), np.ones(4, dtype=bool))
    assert np.isnan([ground.ari, ground.precision, ground.recall, ground.quality]).all()


def test_truth_is_needed():
    with pytest.raises(InputError, match="no point has a known class"):
        score_partition(np.zeros(3, int), np.zeros(3, int), np.zeros((0, 2), int))
    with pytest.raises(InputError, match="2 labels for 3 points"):
        overlaps(np.zeros(2), np.zeros(3))
