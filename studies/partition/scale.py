"""How objects depend on the scale at which their hierarchy is cut, and how stable the cut is."""

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from ellipseg_ros.config import Config
from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.node.grouping import updates
from ellipseg_ros.records import Array, Hierarchy, Segmentation, Sweep
from ellipseg_ros.segmenter import Segmenter
from studies.partition.metrics import (
    UNKNOWN,
    InstanceScores,
    Overlaps,
    adjusted_rand_index,
    class_ious,
    instance_scores,
    overlaps,
    purity,
)
from studies.partition.reading import truth_of

Results = dict[str, Any]  # JSON-ready

STEPS = 12  # scales on either side of the one in force
DOUBLING = 2  # steps to twice the scale, with which each one is compared
PAIRS = 5  # last pairs of updates in a row


def scales(own: float) -> list[float]:
    """The scales that are tried, ascending, the one in force in their middle."""
    return [own * 2.0 ** (step / DOUBLING) for step in range(-STEPS, STEPS + 1)]


def study_scene(sweeps: Iterable[Sweep], config: Config) -> Results:
    """Run a scene and measure all scales on its last windows; JSON-ready.

    Raises EllipsegError if it gives no segments.
    """
    segmenter = Segmenter(replace(config, objects=replace(config.objects, enabled=True)))
    last: deque[Segmentation] = deque(maxlen=PAIRS + 1)
    for group in updates(sweeps, config):
        found = segmenter.process(group)
        if found.restart:
            last.clear()
        last.append(found)
    if not last or not len(last[-1].ids):
        raise EllipsegError("its last window has no segments; it must have some")
    now = last[-1]
    alone = np.arange(len(now.ids))
    return {
        "points": int(now.counts.segmented),
        "segments": len(now.ids),
        "window_s": (now.end_ns - int(now.times_ns.min())) / 1e9,
        "pairs": len(last) - 1,
        "ungrouped": Truth(now).scores(alone),
        "rows": rows(list(last), scales(config.objects.scale)),
    }


def rows(windows: list[Segmentation], tried: list[float]) -> list[Results]:
    """A row a scale, of the last window; of changes with time, means over all pairs."""
    trees = [hierarchy(found) for found in windows]
    common = [in_both(one, other) for one, other in pairwise(windows)]
    truth = Truth(windows[-1])
    counts = diagonal(windows[-1].ellipsoids.count)
    total = float(trees[-1].cost.sum())
    found = []
    for scale in tried:
        cuts = [cut(tree, scale) for tree in trees]
        wider = cut(trees[-1], 2.0 * scale)
        merges = trees[-1].merges_up_to(scale)
        over_scale = regrouped(counts, cuts[-1], wider)
        over_time = [
            regrouped(shared, *two) for shared, two in zip(common, pairwise(cuts), strict=True)
        ]
        found.append(
            {
                "scale": scale,
                "objects": int(cuts[-1].max()) + 1,
                "paid": float(trees[-1].cost[:merges].sum()) / total if total else 0.0,
                "ari_wider": adjusted_rand_index(over_scale),
                "moved_wider": moved(over_scale),
                "ari_next": mean([adjusted_rand_index(one) for one in over_time]),
                "moved_next": mean([moved(one) for one in over_time]),
            }
            | truth.scores(cuts[-1])
        )
    return found


def hierarchy(found: Segmentation) -> Hierarchy:
    """The merges of a window's segments."""
    assert found.objects is not None  # they were asked for
    return found.objects.hierarchy


def cut(tree: Hierarchy, scale: float) -> Array:
    """(s,) the object of every segment at a scale."""
    return tree.labels_after(tree.merges_up_to(scale))


def mean(values: list[float]) -> float | None:
    """None where there is nothing."""
    return float(np.mean(values)) if values else None


# --- overlaps --------------------------------------------------------------------------------


def in_both(one: Segmentation, other: Segmentation) -> Overlaps:
    """How many points the segments of two windows share; `our_values`, `true_values`: rows."""
    _, ours, theirs = np.intersect1d(one.arrival, other.arrival, True, return_indices=True)
    both = (one.labels[ours] >= 0) & (other.labels[theirs] >= 0)
    return overlaps(one.labels[ours][both], other.labels[theirs][both])


def diagonal(count: Array) -> Overlaps:
    """Segments of so many points, and the same ones."""
    rows = np.arange(len(count))
    return Overlaps(rows, rows, count, rows, rows)


def regrouped(shared: Overlaps, ours: Array, theirs: Array | None = None) -> Overlaps:
    """The overlaps of groups, from those of their members; None: left as they are.

    ours, theirs: the group of every one of ours, of theirs.
    """
    one = ours[shared.our_values[shared.ours]]
    other = shared.true_values[shared.truth]
    if theirs is not None:
        other = theirs[other]
    our_values, one = np.unique(one, return_inverse=True)
    true_values, other = np.unique(other, return_inverse=True)
    pairs, place = np.unique(one * len(true_values) + other, return_inverse=True)
    count = np.zeros(len(pairs), np.int64)
    np.add.at(count, place, shared.count)
    width = max(1, len(true_values))
    return Overlaps(pairs // width, pairs % width, count, our_values, true_values)


def moved(shared: Overlaps) -> float:
    """Share of the points that are in another object of theirs than the heir of their own.

    The heir of an object holds most of its points, and has most of its own from it: the rule by
    which ids persist (core/tracking.py). Ties: the first one.
    """
    if not len(shared.count):
        return 0.0
    heir = _most(shared.ours, shared) & _most(shared.truth, shared)
    return 1.0 - float(shared.count[heir].sum() / shared.count.sum())


def _most(group: Array, shared: Overlaps) -> Array:
    """(p,) bool: the pair with most points of its group."""
    order = np.lexsort((shared.truth, shared.ours, -shared.count, group))
    first = np.ones(len(order), bool)
    first[1:] = group[order][1:] != group[order][:-1]
    best = np.zeros(len(order), bool)
    best[order[first]] = True
    return best


# --- truth -----------------------------------------------------------------------------------


class Truth:
    """Classes and things of a window, if they are known, by segment."""

    def __init__(self, found: Segmentation) -> None:
        truth = truth_of(found.fields)
        self._classes = self._known = self._things = None
        if truth is None:
            return
        labels = found.labels
        known = (labels >= 0) & (truth.classes != UNKNOWN)
        self._classes = overlaps(labels[known], truth.classes[known])
        if truth.instances is not None:
            things = known & (truth.instances != UNKNOWN)
            self._known = overlaps(labels[known], truth.instances[known])
            self._things = overlaps(labels[things], truth.instances[things])

    def scores(self, of_segment: Array) -> Results:
        """Of the objects (s,) of the segments; nothing without truth."""
        found: Results = {}
        if self._classes is not None and len(self._classes.count):
            shared = regrouped(self._classes, of_segment)
            found["purity"] = purity(shared)
            found["mean_iou"] = mean(list(class_ious(shared).values()))
        if self._known is not None and self._things is not None:
            known, things = (regrouped(one, of_segment) for one in (self._known, self._things))
            found |= told(instance_scores(known, things))
        return found


def told(scores: InstanceScores) -> Results:
    """What is kept of the scores of things; no NaN, which is no JSON."""
    values = {"ari": scores.ari, "quality": scores.quality}
    return {name: value for name, value in values.items() if not math.isnan(value)}
