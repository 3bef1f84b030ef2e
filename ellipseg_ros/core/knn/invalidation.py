"""Rows whose nearest neighbours change when points enter or leave; the others need no search.

A leaf stores its reach, the largest distance of its points to a neighbour: if no point entered or
left within that distance, its points are not looked at.
"""

import numpy as np

from ellipseg_ros.core.jit import for_parts, kernel
from ellipseg_ros.core.knn.kdtree import LEAF_POINTS, Tree, bound, descend, gap, leaf_parts
from ellipseg_ros.core.knn.search import Search
from ellipseg_ros.records import Array


def rows_gaining(trees: list[Tree], entering: Tree, search: Search) -> Array:
    """(rows,) bool: the queried rows to which an entering point is nearer than their last one."""
    gains = np.zeros(len(search.queried), bool)
    if len(entering.rows):
        for source in trees:
            for_parts(leaf_parts(source), _gaining, source, entering, search, gains)
    return gains


def rows_losing(trees: list[Tree], leaving: Tree, search: Search) -> Array:
    """(rows,) bool: the queried rows that lack a neighbour, or have one below the least state.

    leaving: the points that fell below it since the queried rows were searched.
    """
    loses = np.zeros(len(search.queried), bool)
    for source in trees:
        for_parts(leaf_parts(source), _losing, source, leaving, search, loses)
    return loses


@kernel
def _gaining(first, last, source, entering, search, gains):
    """Mark the queried points in leaves first to last that gain a neighbour."""
    x, y, z, rows, low, high, lowest, depth, _ = entering
    from_x, from_y, from_z, from_rows = source.x, source.y, source.z, source.rows
    queried, _, _, indices, squared = search
    n, k, leaves = len(x), indices.shape[1], 1 << depth
    queries, box = np.empty(LEAF_POINTS, np.int64), np.empty((2, 3))
    stack, gaps = np.empty(64, np.int64), np.empty(64)
    for leaf in range(first, last):
        if not _within_reach(entering, source, leaf, box, stack, gaps):
            continue
        count, reach, last_row = 0, 0.0, -1
        start = (leaf * len(from_x)) >> source.depth
        end = ((leaf + 1) * len(from_x)) >> source.depth
        for position in range(start, end):
            row = from_rows[position]
            if queried[row]:
                queries[count] = position
                reach = max(reach, squared[row, k - 1])
                last_row = max(last_row, indices[row, k - 1])
                count += 1
        if count == 0:
            continue
        bound(from_x, from_y, from_z, queries, count, box)
        stack[0], gaps[0], top = 1, 0.0, 1
        while top > 0:
            top -= 1
            node = stack[top]
            if gaps[top] == reach and lowest[node] > last_row:
                continue
            if node < leaves:
                top = descend(low, high, node, box, reach, stack, gaps, top)
                continue
            start, end = ((node - leaves) * n) >> depth, ((node - leaves + 1) * n) >> depth
            for q in range(count):
                here = queries[q]
                row = from_rows[here]
                for other in range(start, end):
                    dx, dy, dz = (
                        x[other] - from_x[here],
                        y[other] - from_y[here],
                        z[other] - from_z[here],
                    )
                    d = dx * dx + dy * dy + dz * dz
                    if d < squared[row, k - 1] or (
                        d == squared[row, k - 1] and rows[other] < indices[row, k - 1]
                    ):
                        gains[row] = True
                        break


@kernel
def _losing(first, last, source, leaving, search, loses):
    """Mark the queried points in leaves first to last that have lost a neighbour."""
    queried, state, min_state, indices, _ = search
    box, stack, gaps = np.empty((2, 3)), np.empty(64, np.int64), np.empty(64)
    for leaf in range(first, last):
        if not _within_reach(leaving, source, leaf, box, stack, gaps):
            continue
        start = (leaf * len(source.rows)) >> source.depth
        end = ((leaf + 1) * len(source.rows)) >> source.depth
        for position in range(start, end):
            row = source.rows[position]
            if queried[row]:
                loses[row] = lacks_neighbour(row, indices, state, min_state)


@kernel
def lacks_neighbour(row, indices, state, min_state):
    """Whether a row lacks a neighbour, or has one below the least state."""
    for slot in range(indices.shape[1]):
        other = indices[row, slot]
        if other < 0 or state[other] < min_state:
            return True
    return False


@kernel
def _within_reach(other, source, leaf, box, stack, gaps):
    """Whether a point of the other tree may be, or have been, a neighbour of one in a leaf."""
    reach, node = source.reach[leaf], (1 << source.depth) + leaf
    for axis in range(3):
        box[0, axis], box[1, axis] = source.low[node, axis], source.high[node, axis]
    leaves = 1 << other.depth
    stack[0], top = 1, 1
    while top > 0:
        top -= 1
        node = stack[top]
        if node >= leaves:
            if gap(other.low, other.high, node, box) <= reach:
                return True
            continue
        top = descend(other.low, other.high, node, box, reach, stack, gaps, top)
    return False
