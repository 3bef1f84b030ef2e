"""Balanced kd-trees.

Nodes are numbered like a heap, and split at the middle of their longest side, ties by row. A box's
distance is computed by the same monotonic operations as a point's, so it is never above that of a
point inside, and pruning loses nothing.
"""

import math
from typing import NamedTuple

import numpy as np

from ellipseg_ros.core.jit import for_parts, kernel
from ellipseg_ros.records import Array

LEAF_POINTS = 24  # at most in a leaf


class Tree(NamedTuple):
    """Node 1 is the root; node q of level d holds the positions q n >> d to (q + 1) n >> d of the
    points, which lie in the order of the leaves."""

    x: Array  # (n,) float64
    y: Array
    z: Array
    rows: Array  # (n,) int32: the row of the point
    low: Array  # (nodes, 3) float64: corners of the nodes' boxes
    high: Array
    first: Array  # (nodes,) int32: the lowest row of a node; equal points lie in that order
    depth: int  # level of the leaves
    reach: Array  # (leaves,) m^2: no point of a leaf has a neighbour farther; inf: unknown


def build(points: Array, rows: Array) -> Tree:
    """Tree of points[rows]; points (r, 3) float64, finite, rows (n,) int."""
    count = len(rows)
    depth = max(0, int(np.ceil(np.log2(max(count, 1) / LEAF_POINTS))))
    table = np.empty((count, 4))
    table[:, :3] = points[rows]
    table[:, 3] = rows
    low = np.full((2 << depth, 3), np.inf)
    high = np.full((2 << depth, 3), -np.inf)
    top = min(depth, 1)
    first = np.empty(2 << depth, np.int32)
    _split(1, top, table, depth, low, high, first)
    nodes = [(node, depth + 1) for node in range(1 << top, 2 << top)]
    for_parts(nodes, _split, table, depth, low, high, first)
    x, y, z = (np.ascontiguousarray(table[:, axis]) for axis in range(3))
    reach = np.full(1 << depth, np.inf)
    return Tree(x, y, z, table[:, 3].astype(np.int32), low, high, first, depth, reach)


def leaf_parts(tree: Tree) -> list[tuple[int, int]]:
    """The leaves in parts, first to last, for the threads."""
    leaves = 1 << tree.depth
    parts = 8 if leaves > 64 else 1
    return [(leaves * k // parts, leaves * (k + 1) // parts) for k in range(parts)]


@kernel
def _split(node, stop, table, depth, low, high, first):
    """Order `table` below `node` down to the level before `stop`; set the boxes met."""
    stack = [node]
    while len(stack) > 0:
        node = stack.pop()
        level = math.frexp(node)[1] - 1
        position = node - (1 << level)
        start = (position * len(table)) >> level
        end = ((position + 1) * len(table)) >> level
        for axis in range(3):
            low[node, axis], high[node, axis] = np.inf, -np.inf
        first[node] = np.iinfo(np.int32).max
        for i in range(start, end):
            first[node] = min(first[node], np.int32(table[i, 3]))
            for axis in range(3):
                low[node, axis] = min(low[node, axis], table[i, axis])
                high[node, axis] = max(high[node, axis], table[i, axis])
        if level == depth or level >= stop:
            continue
        axis = 0
        for other in range(1, 3):
            if high[node, other] - low[node, other] > high[node, axis] - low[node, axis]:
                axis = other
        middle = ((2 * position + 1) * len(table)) >> (level + 1)
        _select(table, start, end - 1, middle, axis)
        stack.append(2 * node + 1)
        stack.append(2 * node)


@kernel
def _below(table, i, j, axis):
    if table[i, axis] != table[j, axis]:
        return table[i, axis] < table[j, axis]
    return table[i, 3] < table[j, 3]


@kernel
def _select(table, left, right, middle, axis):
    """Hoare's selection by (coordinate, row): earlier entries are below `middle`'s, later not."""
    while left < right:
        a, b, c = left, (left + right) >> 1, right  # the median of these is the pivot
        if _below(table, b, a, axis):
            a, b = b, a
        if _below(table, c, b, axis):
            b = a if _below(table, c, a, axis) else c
        pivot, row = table[b, axis], table[b, 3]
        i, j = left, right
        while i <= j:
            while table[i, axis] < pivot or (table[i, axis] == pivot and table[i, 3] < row):
                i += 1
            while table[j, axis] > pivot or (table[j, axis] == pivot and table[j, 3] > row):
                j -= 1
            if i <= j:
                for column in range(4):
                    table[i, column], table[j, column] = table[j, column], table[i, column]
                i += 1
                j -= 1
        if middle <= j:
            right = j
        elif middle >= i:
            left = i
        else:
            return


@kernel
def bound(x, y, z, queries, count, box):
    """Corners of the box around some positions."""
    for axis in range(3):
        box[0, axis], box[1, axis] = np.inf, -np.inf
    for q in range(count):
        here = queries[q]
        box[0, 0], box[1, 0] = min(box[0, 0], x[here]), max(box[1, 0], x[here])
        box[0, 1], box[1, 1] = min(box[0, 1], y[here]), max(box[1, 1], y[here])
        box[0, 2], box[1, 2] = min(box[0, 2], z[here]), max(box[1, 2], z[here])


@kernel
def descend(low, high, node, box, worst, stack, gaps, top):
    """Stack the children of a node that may hold neighbours, the nearer one on top."""
    left, right = gap(low, high, 2 * node, box), gap(low, high, 2 * node + 1, box)
    nearer = 2 * node if left <= right else 2 * node + 1
    if max(left, right) <= worst:
        stack[top], gaps[top] = 4 * node + 1 - nearer, max(left, right)
        top += 1
    if min(left, right) <= worst:
        stack[top], gaps[top] = nearer, min(left, right)
        top += 1
    return top


@kernel
def gap(low, high, node, box):
    """Squared distance of two boxes; rounding never puts it above that of two points inside."""
    dx = max(0.0, low[node, 0] - box[1, 0], box[0, 0] - high[node, 0])
    dy = max(0.0, low[node, 1] - box[1, 1], box[0, 1] - high[node, 1])
    dz = max(0.0, low[node, 2] - box[1, 2], box[0, 2] - high[node, 2])
    return dx * dx + dy * dy + dz * dz
