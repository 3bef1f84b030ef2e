"""A balanced kd-tree for the k nearest neighbours of all its own points.

Ours rather than a library's, since a neighbour list must be exact to the last tie: ascending
(d^2, index) with d^2 = (dx^2 + dy^2) + dz^2 in float64. A box's distance is computed by the same
monotonic operations, so it is never above that of a point inside, and pruning loses nothing.
All points of a leaf walk down the tree together.
"""

from typing import NamedTuple

import numpy as np

from ellipseg_ros.core.jit import for_parts, kernel
from ellipseg_ros.data import Array

LEAF = 16  # most points a leaf


class Tree(NamedTuple):
    """Nodes are numbered like a heap, root 1; node q of level d holds the positions
    q n >> d to (q + 1) n >> d of the points, which lie in the order of the leaves."""

    x: Array  # (n,) float64; NaN hides a point from queries
    y: Array
    z: Array
    rows: Array  # (n,) int32: the row of the point
    low: Array  # (nodes, 3) float64: corners of the nodes' boxes
    high: Array
    depth: int  # level of the leaves


def build(points: Array) -> Tree:
    """Tree of points (n, 3) float64, finite."""
    count = len(points)
    depth = max(0, int(np.ceil(np.log2(max(count, 1) / LEAF))))
    rows = np.empty((count, 4))
    rows[:, :3] = points
    rows[:, 3] = np.arange(count)
    low = np.full((2 << depth, 3), np.inf)
    high = np.full((2 << depth, 3), -np.inf)
    top = min(depth, 1)
    _split(1, top, rows, depth, low, high)
    for_parts(
        [(node, depth + 1) for node in range(1 << top, 2 << top)], _split, rows, depth, low, high
    )
    x, y, z = (np.ascontiguousarray(rows[:, axis]) for axis in range(3))
    return Tree(x, y, z, rows[:, 3].astype(np.int32), low, high, depth)


def hide(tree: Tree, hidden: Array) -> None:
    """Hide the points of the rows where `hidden` (n,) bool from later queries."""
    tree.x[hidden[tree.rows]] = np.nan


def nearest(tree: Tree, wanted: Array, found: Array, squared: Array) -> None:
    """Fill rows of `found` (n, k) int32 and `squared` (n, k) m^2 where `wanted` (n,) bool.

    Ascending by (d^2, index), the point itself left out by its index; -1 and inf where there are
    fewer than k others.
    """
    leaves = 1 << tree.depth
    parts = (
        [(leaves * k // 8, leaves * (k + 1) // 8) for k in range(8)]
        if leaves > 64
        else [(0, leaves)]
    )
    for_parts(parts, _nearest, tree, wanted, found, squared)


@kernel
def _split(node, stop, rows, depth, low, high):
    """Order `rows` below `node` down to the level before `stop`; set the boxes met."""
    stack = [node]
    while len(stack) > 0:
        node = stack.pop()
        level = 0
        while (node >> level) > 1:
            level += 1
        position = node - (1 << level)
        start = (position * len(rows)) >> level
        end = ((position + 1) * len(rows)) >> level
        for i in range(start, end):
            for axis in range(3):
                low[node, axis] = min(low[node, axis], rows[i, axis])
                high[node, axis] = max(high[node, axis], rows[i, axis])
        if level == depth or level >= stop:
            continue
        axis = 0
        for other in range(1, 3):
            if high[node, other] - low[node, other] > high[node, axis] - low[node, axis]:
                axis = other
        middle = ((2 * position + 1) * len(rows)) >> (level + 1)
        _select(rows, start, end - 1, middle, axis)
        stack.append(2 * node + 1)
        stack.append(2 * node)


@kernel
def _select(rows, left, right, middle, axis):
    """Hoare's selection: on `axis`, earlier rows are at most, later ones at least `middle`'s."""
    while left < right:
        a, b, c = rows[left, axis], rows[(left + right) >> 1, axis], rows[right, axis]
        pivot = max(min(a, b), min(max(a, b), c))
        i, j = left, right
        while i <= j:
            while rows[i, axis] < pivot:
                i += 1
            while rows[j, axis] > pivot:
                j -= 1
            if i <= j:
                for column in range(4):
                    rows[i, column], rows[j, column] = rows[j, column], rows[i, column]
                i += 1
                j -= 1
        if middle <= j:
            right = j
        elif middle >= i:
            left = i
        else:
            return


@kernel
def _nearest(first, last, tree, wanted, found, squared):  # noqa: PLR0915  # see below
    """The neighbours of the points in the leaves first to last.

    With the insertion in a function of its own, or the arrays taken out of the tuple further down,
    it takes 1.5 times as long: numba counts references at every call.
    """
    x, y, z, rows, low, high, depth = tree
    n, k, leaves = len(x), found.shape[1], 1 << depth
    near, near_squared = np.empty((LEAF, k), np.int32), np.empty((LEAF, k))
    queries, box = np.empty(LEAF, np.int64), np.empty((2, 3))
    stack, gaps = np.empty(64, np.int64), np.empty(64)
    for leaf in range(first, last):
        count = 0
        for position in range((leaf * n) >> depth, ((leaf + 1) * n) >> depth):
            if wanted[rows[position]] and not np.isnan(x[position]):
                queries[count] = position
                for slot in range(k):
                    near[count, slot], near_squared[count, slot] = -1, np.inf
                count += 1
        if count == 0:
            continue
        _bound(x, y, z, queries, count, box)
        # Down the tree: the own leaf first, then always the nearer child.
        stack[0], gaps[0], stack[1], gaps[1], top = 1, 0.0, leaves + leaf, 0.0, 2
        worst, fresh = np.inf, True
        while top > 0:
            top -= 1
            node = stack[top]
            if gaps[top] > worst or (node == leaves + leaf and not fresh):
                continue
            if node < leaves:
                top = _descend(low, high, node, box, worst, stack, gaps, top)
                continue
            fresh = False
            start, end = ((node - leaves) * n) >> depth, ((node - leaves + 1) * n) >> depth
            worst = 0.0
            for q in range(count):
                here = queries[q]
                px, py, pz = x[here], y[here], z[here]
                limit = near_squared[q, k - 1]
                dx = max(0.0, low[node, 0] - px, px - high[node, 0])
                dy = max(0.0, low[node, 1] - py, py - high[node, 1])
                dz = max(0.0, low[node, 2] - pz, pz - high[node, 2])
                if dx * dx + dy * dy + dz * dz <= limit:
                    for other in range(start, end):
                        dx, dy, dz = x[other] - px, y[other] - py, z[other] - pz
                        d = dx * dx + dy * dy + dz * dz
                        if d <= limit and other != here:
                            candidate = rows[other]
                            slot = k - 1
                            if d == limit and near[q, slot] >= 0 and candidate > near[q, slot]:
                                continue
                            while slot > 0:
                                before = near_squared[q, slot - 1]
                                if d > before or (d == before and candidate > near[q, slot - 1]):
                                    break
                                near[q, slot] = near[q, slot - 1]
                                near_squared[q, slot] = before
                                slot -= 1
                            near[q, slot], near_squared[q, slot] = candidate, d
                            limit = near_squared[q, k - 1]
                worst = max(worst, limit)
        for q in range(count):
            row = rows[queries[q]]
            for slot in range(k):
                found[row, slot], squared[row, slot] = near[q, slot], near_squared[q, slot]


@kernel
def _bound(x, y, z, queries, count, box):
    """Corners of the box around some positions."""
    box[0], box[1] = np.inf, -np.inf
    for q in range(count):
        here = queries[q]
        box[0, 0], box[1, 0] = min(box[0, 0], x[here]), max(box[1, 0], x[here])
        box[0, 1], box[1, 1] = min(box[0, 1], y[here]), max(box[1, 1], y[here])
        box[0, 2], box[1, 2] = min(box[0, 2], z[here]), max(box[1, 2], z[here])


@kernel
def _descend(low, high, node, box, worst, stack, gaps, top):
    """Stack the children of a node that may hold neighbours, the nearer one on top."""
    left, right = _gap(low, high, 2 * node, box), _gap(low, high, 2 * node + 1, box)
    nearer = 2 * node if left <= right else 2 * node + 1
    if max(left, right) <= worst:
        stack[top], gaps[top] = 4 * node + 1 - nearer, max(left, right)
        top += 1
    if min(left, right) <= worst:
        stack[top], gaps[top] = nearer, min(left, right)
        top += 1
    return top


@kernel
def _gap(low, high, node, box):
    """Squared distance of two boxes; rounding never puts it above that of two points inside."""
    dx = max(0.0, low[node, 0] - box[1, 0], box[0, 0] - high[node, 0])
    dy = max(0.0, low[node, 1] - box[1, 1], box[0, 1] - high[node, 1])
    dz = max(0.0, low[node, 2] - box[1, 2], box[0, 2] - high[node, 2])
    return dx * dx + dy * dy + dz * dz
