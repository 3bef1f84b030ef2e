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


def groups_of_points(labels: Array, group: Array) -> Array:
    """The group (n,) int32 of every point, -1 for none.

    labels (n,) int32: the segment of every point, negative for none; group (s,) int32: the group
    of every segment, -1 for none.
    """
    return np.asarray(np.append(group, np.int32(-1))[np.maximum(labels, -1)])


def group_members(labels: Array, count: int) -> Members:
    """The points of groups; labels (n,) int32: the group of every point, negative for none."""
    starts = np.append(0, np.cumsum(np.bincount(labels[labels >= 0], minlength=count)))
    rows = np.empty(starts[-1], np.int64)
    _distribute(labels, starts[:-1].copy(), rows)
    return Members(starts, rows)


def group_boxes(points: Array, labels: Array, count: int) -> Boxes:
    """Bounding boxes of the points (n, 3) of groups; labels: as for `group_members`."""
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    _extend(points, labels, low, high)
    return Boxes(low, high)


@kernel
def _distribute(labels, place, rows):
    for i in range(len(labels)):
        into = labels[i]
        if into >= 0:
            rows[place[into]] = i
            place[into] += 1


@kernel
def _extend(points, labels, low, high):
    for i in range(len(labels)):
        into = labels[i]
        if into >= 0:
            for axis in range(3):
                low[into, axis] = min(low[into, axis], points[i, axis])
                high[into, axis] = max(high[into, axis], points[i, axis])
