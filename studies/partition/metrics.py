"""How good a partition is: labels against truth.

Points that the truth says nothing about take no part: truth 0, as in the labelled scans and in
simulated scenes. Every point must have a segment.
"""

from dataclasses import dataclass

import numpy as np

from ellipseg_ros.core.contingency import contingency
from ellipseg_ros.errors import InputError
from ellipseg_ros.records import Array

UNKNOWN = 0  # in the truth: class not known; of instances: no thing, but ground
TOLERANCE = 1  # edges by which a boundary may be off
LEAST = 12  # points of an instance, or of a segment, that counts as an object
MATCH = 0.5  # intersection over union beyond which two can match one another only


@dataclass(frozen=True)
class PartitionScores:
    """How well segments keep apart what has different classes."""

    purity: float
    mean_iou: float
    iou: dict[int, float]  # by class
    boundary_recall: float  # NaN if there is no boundary in the truth
    boundary_precision: float  # NaN if there is none between segments
    under_segmentation: float


@dataclass(frozen=True)
class InstanceScores:
    """How well segments are the things that there are."""

    ari: float
    precision: float  # NaN if no segment is an object
    recall: float  # NaN if there is no instance
    quality: float  # panoptic


@dataclass(frozen=True)
class Overlaps:
    """How many points two labellings share: row i is a pair that shares any, sorted."""

    ours: Array  # (p,) int64, numbers from 0
    truth: Array  # (p,) int64
    count: Array  # (p,) int64
    our_values: Array  # (s,): what was labelled 0, 1, ...; ascending
    true_values: Array  # (t,)

    @property
    def our_sizes(self) -> Array:
        """(s,) int64 points."""
        return _sums(self.ours, self.count, len(self.our_values))

    @property
    def true_sizes(self) -> Array:
        """(t,) int64 points."""
        return _sums(self.truth, self.count, len(self.true_values))


def overlaps(labels: Array, truth: Array) -> Overlaps:
    """Count the points of every pair of labels that occurs. Both (n,) integers."""
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

    labels, classes: (n,) integers; class 0 is not known. edges: (m, 2) pairs of neighbours, of
    which those that end in an unknown point are left out. InputError if no class is known.
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
    """Share of points that have the commonest class of their segment.

    Also achievable segmentation accuracy (Liu et al. 2011, entropy rate superpixels), or oracle
    overall accuracy (Landrieu and Boussaha 2019).
    """
    return float(_largest(shared).sum() / shared.count.sum())


def class_ious(shared: Overlaps) -> dict[int, float]:
    """Intersection over union of every class of the truth, segments voting by majority.

    Ties: the lower class. A class that no segment votes for has 0. Everingham et al. (2015), The
    PASCAL visual object classes challenge: the score of its segmentation task.
    """
    vote = majorities(shared)
    right = shared.truth == vote[shared.ours]
    width = len(shared.true_values)
    hit = _sums(shared.truth[right], shared.count[right], width)
    said = _sums(vote, shared.our_sizes, width)
    iou = hit / (shared.true_sizes + said - hit)
    return dict(zip(shared.true_values.tolist(), iou.tolist(), strict=True))


def majorities(shared: Overlaps) -> Array:
    """(s,) row of `true_values` that is commonest in every segment; ties: the lower one."""
    most = shared.count == _largest(shared)[shared.ours]
    vote = np.full(len(shared.our_values), len(shared.true_values))
    np.minimum.at(vote, shared.ours[most], shared.truth[most])
    return vote


def under_segmentation(shared: Overlaps) -> float:
    """Points by which segments leak over the classes, as a share: 0 is best.

    Of every segment that touches a class, the smaller of its two parts, inside and outside:
    Neubert and Protzel (2012), Superpixel benchmark and comparison, the corrected error.
    """
    outside = shared.our_sizes[shared.ours] - shared.count
    return float(np.minimum(shared.count, outside).sum() / shared.count.sum())


def boundary_recall(found: Array, wanted: Array, edges: Array) -> float:
    """Share of the edges between different `wanted` that are, nearly, between different `found`.

    Nearly: an edge counts too if it shares a point with one that is. With the two arguments
    exchanged, it is the precision. (n,) labels, edges (m, 2); NaN if no edge is wanted.
    Landrieu and Boussaha (2019), Point cloud oversegmentation with graph-structured deep metric
    learning, with their tolerance of one edge.
    """
    crossing = wanted[edges[:, 0]] != wanted[edges[:, 1]]
    if not crossing.any():
        return float("nan")
    near = found[edges[:, 0]] != found[edges[:, 1]]
    for _ in range(TOLERANCE):
        touched = np.zeros(len(found), dtype=bool)
        touched[edges[near]] = True
        near = touched[edges].any(axis=1)
    return float(near[crossing].mean())


def score_instances(labels: Array, instances: Array, known: Array) -> InstanceScores:
    """Score segments by the things that their points belong to.

    labels, instances: (n,) integers; instance 0 is no thing, but ground. known: (n,) bool, False
    where the truth says nothing.
    """
    things = known & (instances != UNKNOWN)
    return instance_scores(
        overlaps(labels[known], instances[known]), overlaps(labels[things], instances[things])
    )


def instance_scores(known: Overlaps, things: Overlaps) -> InstanceScores:
    """Score segments by overlaps with instances: of all known points, and of those of things."""
    tally = match_objects(known)
    matched, spare, missed = len(tally.ious), tally.spare, tally.missed
    weight = matched + 0.5 * spare + 0.5 * missed
    return InstanceScores(
        ari=adjusted_rand_index(things),
        precision=_share(matched, matched + spare),
        recall=_share(matched, matched + missed),
        quality=_share(float(tally.ious.sum()), weight),
    )


@dataclass(frozen=True)
class Matches:
    """Which segments are things."""

    ious: Array  # (k,) of the matched pairs
    spare: int  # segments that are objects and match nothing
    missed: int  # things that nothing matches


def match_objects(shared: Overlaps) -> Matches:
    """Match segments with the instances of which they hold more than half, and hardly more.

    Pairs match if their intersection over union is above 0.5, which no two segments can have with
    one instance. Instances of fewer than 12 points are void. A segment is an object if it has 12
    points or more and more than half of them are of instances that count. Kirillov et al. (2019),
    Panoptic segmentation, segment matching and panoptic quality.
    """
    ours, theirs = shared.our_sizes, shared.true_sizes
    counts = (shared.true_values != UNKNOWN) & (theirs >= LEAST)
    iou = shared.count / (ours[shared.ours] + theirs[shared.truth] - shared.count)
    pairs = counts[shared.truth] & (iou > MATCH)
    inside = _sums(shared.ours, shared.count * counts[shared.truth], len(ours))
    objects = (ours >= LEAST) & (2 * inside > ours)
    objects[shared.ours[pairs]] = False
    return Matches(iou[pairs], int(objects.sum()), int(counts.sum() - pairs.sum()))


def adjusted_rand_index(shared: Overlaps) -> float:
    """Agreement of two partitions on pairs of points: 1 if they are one, near 0 by chance.

    Hubert and Arabie (1985), Comparing partitions. NaN without points; 1 if both are
    trivial in the same way.
    """
    total = _pairs(shared.count.sum())
    if not shared.count.size:
        return float("nan")
    both = _pairs(shared.count).sum()
    ours, theirs = _pairs(shared.our_sizes).sum(), _pairs(shared.true_sizes).sum()
    chance = ours * theirs / total if total else 0.0
    most = 0.5 * (ours + theirs)
    return 1.0 if most == chance else float((both - chance) / (most - chance))


def _pairs(counts: Array) -> Array:
    """Pairs within groups of so many; float64, since 10^6 points make 5 * 10^11."""
    many = np.asarray(counts, dtype=np.float64)
    return np.asarray(many * (many - 1.0) / 2.0)


def _largest(shared: Overlaps) -> Array:
    """(s,) points of the commonest class of every segment."""
    most = np.zeros(len(shared.our_values), np.int64)
    np.maximum.at(most, shared.ours, shared.count)
    return most


def _sums(group: Array, count: Array, length: int) -> Array:
    """(length,) int64: the counts of every group, added up; bincount would make them floats."""
    total = np.zeros(length, np.int64)
    np.add.at(total, group, count)
    return total


def _share(part: float, whole: float) -> float:
    return part / whole if whole else float("nan")
