"""Scores of a partition against true classes and instances.

Points of unknown class (0, in labelled scans and in simulated scenes) are ignored. Every point
must have a segment.
"""

from dataclasses import dataclass

import numpy as np

from ellipseg_ros.core.contingency import contingency
from ellipseg_ros.errors import InputError
from ellipseg_ros.records import Array

UNKNOWN = 0  # class; as an instance: ground
TOLERANCE = 1  # edges by which a boundary may be off
MIN_POINTS = 12  # of an instance or a segment that can be matched
MIN_IOU = 0.5  # intersection over union above which a match is unique


@dataclass(frozen=True)
class PartitionScores:
    """Agreement of segments with classes."""

    purity: float
    mean_iou: float
    iou: dict[int, float]  # by class
    boundary_recall: float  # NaN if there is no boundary between classes
    boundary_precision: float  # NaN if there is no boundary between segments
    under_segmentation: float


@dataclass(frozen=True)
class InstanceScores:
    """Agreement of segments with instances."""

    ari: float
    precision: float  # NaN if no segment counts
    recall: float  # NaN if there is no instance
    quality: float  # panoptic quality


@dataclass(frozen=True)
class Overlaps:
    """Contingency table of two labellings; row i: a pair of labels with common points, sorted."""

    ours: Array  # (p,) int64, numbers from 0
    truth: Array  # (p,) int64
    count: Array  # (p,) int64
    our_values: Array  # (s,): the labels numbered 0, 1, ...; ascending
    true_values: Array  # (t,)

    @property
    def our_sizes(self) -> Array:
        """(s,) int64: points of each of our labels."""
        return _sums(self.ours, self.count, len(self.our_values))

    @property
    def true_sizes(self) -> Array:
        """(t,) int64: points of each true label."""
        return _sums(self.truth, self.count, len(self.true_values))


def overlaps(labels: Array, truth: Array) -> Overlaps:
    """Count the common points of all pairs of labels; both (n,) integers."""
    if len(labels) != len(truth):
        raise InputError(f"there are {len(labels)} labels for {len(truth)} points", "shape")
    our_values, ours = np.unique(labels, return_inverse=True)
    true_values, theirs = np.unique(truth, return_inverse=True)
    ours, theirs = ours.reshape(-1).astype(np.int32), theirs.reshape(-1).astype(np.int32)
    table = contingency(ours, theirs, (len(our_values), len(true_values)))
    pairs = table.rows.astype(np.int64), table.columns.astype(np.int64)
    return Overlaps(*pairs, table.counts, our_values, true_values)


def score_partition(labels: Array, classes: Array, edges: Array) -> PartitionScores:
    """Score segments by the classes of their points.

    labels, classes: (n,) integers; class 0 is unknown. edges: (m, 2) pairs of neighbours; those
    with a point of unknown class are ignored. InputError if no class is known.
    """
    known = classes != UNKNOWN
    if not known.any():
        raise InputError("no point has a known class; some must have one", "truth")
    inside = edges[known[edges[:, 0]] & known[edges[:, 1]]]
    shared = overlaps(labels[known], classes[known])
    iou = class_ious(shared)
    return PartitionScores(
        purity=purity(shared),
        mean_iou=float(np.mean(list(iou.values()))),
        iou=iou,
        boundary_recall=boundary_recall(labels, classes, inside),
        boundary_precision=boundary_recall(classes, labels, inside),
        under_segmentation=under_segmentation(shared),
    )


def purity(shared: Overlaps) -> float:
    """Share of points with the most frequent class of their segment.

    Also achievable segmentation accuracy (Liu et al. 2011, entropy rate superpixels), or oracle
    overall accuracy (Landrieu and Boussaha 2019).
    """
    return float(_largest(shared).sum() / shared.count.sum())


def class_ious(shared: Overlaps) -> dict[int, float]:
    """Intersection over union of every true class; a segment predicts its most frequent class.

    Ties: the lower class. A class that no segment predicts has 0. Everingham et al. (2015), The
    PASCAL visual object classes challenge: the score of its segmentation task.
    """
    predicted = majorities(shared)
    right = shared.truth == predicted[shared.ours]
    width = len(shared.true_values)
    common = _sums(shared.truth[right], shared.count[right], width)
    union = shared.true_sizes + _sums(predicted, shared.our_sizes, width) - common
    iou = common / union
    return dict(zip(shared.true_values.tolist(), iou.tolist(), strict=True))


def majorities(shared: Overlaps) -> Array:
    """(s,) row of `true_values` that is most frequent in every segment; ties: the lower one."""
    largest = shared.count == _largest(shared)[shared.ours]
    majority = np.full(len(shared.our_values), len(shared.true_values))
    np.minimum.at(majority, shared.ours[largest], shared.truth[largest])
    return majority


def under_segmentation(shared: Overlaps) -> float:
    """Share of points by which segments leak over class boundaries; 0 is best.

    For every segment and class in it, the smaller of the two parts inside and outside the class:
    Neubert and Protzel (2012), Superpixel benchmark and comparison, the corrected error.
    """
    outside = shared.our_sizes[shared.ours] - shared.count
    return float(np.minimum(shared.count, outside).sum() / shared.count.sum())


def boundary_recall(predicted: Array, reference: Array, edges: Array) -> float:
    """Share of the boundary edges of `reference` that are boundary edges of `predicted`.

    An edge that shares a point with a predicted boundary edge counts, too. With the arguments
    exchanged, it is the precision. (n,) labels, edges (m, 2); NaN without boundary edges.
    Landrieu and Boussaha (2019), Point cloud oversegmentation with graph-structured deep metric
    learning, with their tolerance of one edge.
    """
    crossing = reference[edges[:, 0]] != reference[edges[:, 1]]
    if not crossing.any():
        return float("nan")
    near = predicted[edges[:, 0]] != predicted[edges[:, 1]]
    for _ in range(TOLERANCE):
        touched = np.zeros(len(predicted), dtype=bool)
        touched[edges[near]] = True
        near = touched[edges].any(axis=1)
    return float(near[crossing].mean())


def score_instances(labels: Array, instances: Array, known: Array) -> InstanceScores:
    """Score segments by the instances of their points.

    labels, instances: (n,) integers; instance 0 is ground. known: (n,) bool, False for points of
    unknown class.
    """
    objects = known & (instances != UNKNOWN)
    return instance_scores(
        overlaps(labels[known], instances[known]), overlaps(labels[objects], instances[objects])
    )


def instance_scores(known: Overlaps, objects: Overlaps) -> InstanceScores:
    """Scores from overlaps with instances, over all known points and over those of no ground."""
    matches = match_objects(known)
    matched, unmatched, missed = len(matches.ious), matches.unmatched, matches.missed
    weight = matched + 0.5 * unmatched + 0.5 * missed
    return InstanceScores(
        ari=adjusted_rand_index(objects),
        precision=_share(matched, matched + unmatched),
        recall=_share(matched, matched + missed),
        quality=_share(float(matches.ious.sum()), weight),
    )


@dataclass(frozen=True)
class Matches:
    """Matches of segments and instances."""

    ious: Array  # (k,) of the matched pairs
    unmatched: int  # segments that count and match no instance
    missed: int  # instances that no segment matches


def match_objects(shared: Overlaps) -> Matches:
    """Match segments with instances.

    A pair matches if its intersection over union is above 0.5, which at most one segment can have
    with an instance. Instances of fewer than 12 points are ignored. A segment counts if it has 12
    points or more, and more than half of them are of instances that are not ignored.
    Kirillov et al. (2019), Panoptic segmentation, segment matching and panoptic quality.
    """
    ours, theirs = shared.our_sizes, shared.true_sizes
    counts = (shared.true_values != UNKNOWN) & (theirs >= MIN_POINTS)
    iou = shared.count / (ours[shared.ours] + theirs[shared.truth] - shared.count)
    pairs = counts[shared.truth] & (iou > MIN_IOU)
    inside = _sums(shared.ours, shared.count * counts[shared.truth], len(ours))
    objects = (ours >= MIN_POINTS) & (2 * inside > ours)
    objects[shared.ours[pairs]] = False
    return Matches(iou[pairs], int(objects.sum()), int(counts.sum() - pairs.sum()))


def adjusted_rand_index(shared: Overlaps) -> float:
    """Agreement of two partitions on pairs of points: 1 if identical, about 0 by chance.

    Hubert and Arabie (1985), Comparing partitions. NaN without points; 1 if both are one segment
    or both are singletons.
    """
    total = _pairs(shared.count.sum())
    if not shared.count.size:
        return float("nan")
    both = _pairs(shared.count).sum()
    ours, theirs = _pairs(shared.our_sizes).sum(), _pairs(shared.true_sizes).sum()
    chance = ours * theirs / total if total else 0.0
    highest = 0.5 * (ours + theirs)
    return 1.0 if highest == chance else float((both - chance) / (highest - chance))


def _pairs(counts: Array) -> Array:
    """Numbers of pairs within groups; float64, since 10^6 points have 5 * 10^11."""
    sizes = np.asarray(counts, dtype=np.float64)
    return np.asarray(sizes * (sizes - 1.0) / 2.0)


def _largest(shared: Overlaps) -> Array:
    """(s,) points of the most frequent class of every segment."""
    largest = np.zeros(len(shared.our_values), np.int64)
    np.maximum.at(largest, shared.ours, shared.count)
    return largest


def _sums(group: Array, count: Array, length: int) -> Array:
    """(length,) int64: sum of the counts of every group; bincount would return floats."""
    total = np.zeros(length, np.int64)
    np.add.at(total, group, count)
    return total


def _share(part: float, whole: float) -> float:
    return part / whole if whole else float("nan")
