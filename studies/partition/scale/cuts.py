"""Objects over the scale at which their hierarchy is cut, and the stability of the cut."""

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
    Overlaps,
    adjusted_rand_index,
    class_ious,
    instance_scores,
    overlaps,
    purity,
)
from studies.partition.truth import truth_of

Results = dict[str, Any]  # JSON-ready

STEPS = 12  # scales below and above the current one
DOUBLING = 2  # steps from a scale to its double
MAX_PAIRS = 5  # of consecutive updates, the last ones


def scales(current: float) -> list[float]:
    """All scales to cut at, ascending, with the current one in the middle."""
    return [current * 2.0 ** (step / DOUBLING) for step in range(-STEPS, STEPS + 1)]


def study_scene(sweeps: Iterable[Sweep], config: Config) -> Results:
    """Segment a scene and measure all scales on its last windows; JSON-ready.

    Raises EllipsegError if the last window has no segments.
    """
    segmenter = Segmenter(replace(config, objects=replace(config.objects, enabled=True)))
    last: deque[Segmentation] = deque(maxlen=MAX_PAIRS + 1)
    for group in updates(sweeps, config):
        window = segmenter.process(group)
        if window.restart:
            last.clear()
        last.append(window)
    if not last or not len(last[-1].ids):
        raise EllipsegError("its last window has no segments; it must have some")
    window = last[-1]
    singletons = np.arange(len(window.ids))
    return {
        "points": int(window.counts.segmented),
        "segments": len(window.ids),
        "window_s": (window.end_ns - int(window.times_ns.min())) / 1e9,
        "pairs": len(last) - 1,
        "ungrouped": WindowTruth(window).scores(singletons),
        "rows": rows(list(last), scales(config.objects.scale)),
    }


def rows(windows: list[Segmentation], scales: list[float]) -> list[Results]:
    """A row per scale: measures of the last window, and means over all pairs of updates."""
    trees = [hierarchy(window) for window in windows]
    common = [shared_points(*pair) for pair in pairwise(windows)]
    truth = WindowTruth(windows[-1])
    counts = identical(windows[-1].ellipsoids.count)
    total = float(trees[-1].cost.sum())
    measured = []
    for scale in scales:
        cuts = [cut(tree, scale) for tree in trees]
        doubled = cut(trees[-1], 2.0 * scale)
        merges = trees[-1].merges_up_to(scale)
        over_scale = regrouped(counts, cuts[-1], doubled)
        over_time = [
            regrouped(shared, *pair) for shared, pair in zip(common, pairwise(cuts), strict=True)
        ]
        measured.append(
            {
                "scale": scale,
                "objects": int(cuts[-1].max()) + 1,
                "cost_share": float(trees[-1].cost[:merges].sum()) / total if total else 0.0,
                "ari_doubled": adjusted_rand_index(over_scale),
                "moved_doubled": moved(over_scale),
                "ari_next": mean([adjusted_rand_index(one) for one in over_time]),
                "moved_next": mean([moved(one) for one in over_time]),
            }
            | truth.scores(cuts[-1])
        )
    return measured


def hierarchy(window: Segmentation) -> Hierarchy:
    """The merges of the segments of a window."""
    assert window.objects is not None  # study_scene enables them
    return window.objects.hierarchy


def cut(tree: Hierarchy, scale: float) -> Array:
    """(s,) object of every segment at a scale."""
    return tree.labels_after(tree.merges_up_to(scale))


def mean(values: list[float]) -> float | None:
    """The mean; None of no values."""
    return float(np.mean(values)) if values else None


# --- overlaps --------------------------------------------------------------------------------


def shared_points(first: Segmentation, second: Segmentation) -> Overlaps:
    """Numbers of points that the segments of two windows share, by rows of segments."""
    _, ours, theirs = np.intersect1d(first.arrival, second.arrival, True, return_indices=True)
    both = (first.labels[ours] >= 0) & (second.labels[theirs] >= 0)
    return overlaps(first.labels[ours][both], second.labels[theirs][both])


def identical(count: Array) -> Overlaps:
    """Overlaps of segments of `count` points with themselves."""
    rows = np.arange(len(count))
    return Overlaps(rows, rows, count, rows, rows)


def regrouped(shared: Overlaps, ours: Array, theirs: Array | None = None) -> Overlaps:
    """Overlaps of groups, from those of their members.

    ours, theirs: group of every member on either side; theirs None: no groups there.
    """
    our_group = ours[shared.our_values[shared.ours]]
    their_group = shared.true_values[shared.truth]
    if theirs is not None:
        their_group = theirs[their_group]
    our_values, our_row = np.unique(our_group, return_inverse=True)
    true_values, their_row = np.unique(their_group, return_inverse=True)
    pairs, place = np.unique(our_row * len(true_values) + their_row, return_inverse=True)
    count = np.zeros(len(pairs), np.int64)
    np.add.at(count, place, shared.count)
    width = max(1, len(true_values))
    return Overlaps(pairs // width, pairs % width, count, our_values, true_values)


def moved(shared: Overlaps) -> float:
    """Share of the points that are not in the successor of their object.

    The successor of an object holds most of its points and has most of its own points from it:
    the rule by which ids persist (core/tracking.py). Ties: the first one.
    """
    if not len(shared.count):
        return 0.0
    successor = _largest(shared.ours, shared) & _largest(shared.truth, shared)
    return 1.0 - float(shared.count[successor].sum() / shared.count.sum())


def _largest(group: Array, shared: Overlaps) -> Array:
    """(p,) bool: the pair with the most points of its group."""
    order = np.lexsort((shared.truth, shared.ours, -shared.count, group))
    first = np.ones(len(order), bool)
    first[1:] = group[order][1:] != group[order][:-1]
    best = np.zeros(len(order), bool)
    best[order[first]] = True
    return best


# --- truth -----------------------------------------------------------------------------------


class WindowTruth:
    """Classes and instances of a window by segment, where they are known."""

    def __init__(self, window: Segmentation) -> None:
        truth = truth_of(window.fields)
        self._classes = self._known = self._instances = None
        if truth is None:
            return
        labels = window.labels
        known = (labels >= 0) & (truth.classes != UNKNOWN)
        self._classes = overlaps(labels[known], truth.classes[known])
        if truth.instances is not None:
            of_things = known & (truth.instances != UNKNOWN)
            self._known = overlaps(labels[known], truth.instances[known])
            self._instances = overlaps(labels[of_things], truth.instances[of_things])

    def scores(self, of_segment: Array) -> Results:
        """Scores of objects, given the object (s,) of every segment; empty without truth."""
        scores: Results = {}
        if self._classes is not None and len(self._classes.count):
            shared = regrouped(self._classes, of_segment)
            scores["purity"] = purity(shared)
            scores["mean_iou"] = mean(list(class_ious(shared).values()))
        if self._known is not None and self._instances is not None:
            pair = (regrouped(one, of_segment) for one in (self._known, self._instances))
            values = instance_scores(*pair)
            named = {"ari": values.ari, "quality": values.quality}
            scores |= {name: value for name, value in named.items() if not math.isnan(value)}
        return scores
