"""Points of groups of segments, and their bounding boxes."""

from typing import NamedTuple

import numpy as np

from ellipseg_ros.core.jit import kernel
from ellipseg_ros.records import Array


class Members(NamedTuple):
    """Points of every group, ascending: rows[starts[g]:starts[g + 1]] are those of group g."""

    starts: Array  # (g + 1,) int64
    rows: Array  # (m,) int64


class Boxes(NamedTuple):
    """Bounding boxes along the axes of the frame, m; g of them."""

    low: Array  # (g, 3)
    high: Array  # (g, 3)


def group_members(labels: Array, group: Array, count: int) -> Members:
    """The points of groups of segments.

    labels (n,) int32: the segment of every point, negative for none; group (s,) int32: the group
    of every segment, negative for none; count: of groups.
    """
    starts = np.zeros(count + 1, np.int64)
    _count(labels, group, starts)
    np.cumsum(starts, out=starts)
    rows = np.empty(starts[-1], np.int64)
    _distribute(labels, group, starts[:-1].copy(), rows)
    return Members(starts, rows)


def group_boxes(points: Array, labels: Array, group: Array, count: int) -> Boxes:
    """Bounding boxes of the points (n, 3) of groups; labels, group: as for `group_members`."""
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    _extend(points, labels, group, low, high)
    return Boxes(low, high)


@kernel
def _count(labels, group, starts):
    for label in labels:
        if label >= 0 and group[label] >= 0:
            starts[group[label] + 1] += 1


@kernel
def _distribute(labels, group, place, rows):
    for i in range(len(labels)):
        if labels[i] >= 0 and group[labels[i]] >= 0:
            into = group[labels[i]]
            rows[place[into]] = i
            place[into] += 1


@kernel
def _extend(points, labels, group, low, high):
    for i in range(len(labels)):
        if labels[i] >= 0 and group[labels[i]] >= 0:
            into = group[labels[i]]
            for axis in range(3):
                low[into, axis] = min(low[into, axis], points[i, axis])
                high[into, axis] = max(high[into, axis], points[i, axis])
