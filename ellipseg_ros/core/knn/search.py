"""The k nearest neighbours of many points at a time.

Not a library's, since a list of neighbours must be exact to the last tie: ascending (d^2, row)
with d^2 = (dx^2 + dy^2) + dz^2 in float64. The points of a leaf descend the tree together.
"""

from typing import NamedTuple

import numpy as np

from ellipseg_ros.core.jit import for_parts, kernel
from ellipseg_ros.core.knn.kdtree import LEAF_POINTS, Tree, bound, descend, leaf_parts
from ellipseg_ros.records import Array


class Search(NamedTuple):
    """Which rows are queried, among which rows, and where their neighbours go; arrays by row."""

    queried: Array  # (rows,) bool
    state: Array  # (rows,) uint8
    min_state: int  # only points of at least this state are neighbours
    indices: Array  # (rows, k) int32, ascending by (d^2, row), never the point itself; -1: none
    squared: Array  # (rows, k) float64: squared distances, m^2; inf for none


def search_neighbours(trees: list[Tree], search: Search) -> None:
    """Fill the queried rows of `indices` and `squared`; every point is in one of the trees."""
    for source in trees:
        for target in (source, *(tree for tree in trees if tree is not source)):
            for_parts(leaf_parts(source), _search, source, target, target is source, search)
        for_parts(leaf_parts(source), _set_reach, source, search)


@kernel
def _search(first, last, source, target, same_tree, search):  # noqa: PLR0915  # see below
    """Find the neighbours in `target` of the queried points in leaves first to last of `source`.

    same_tree: the lists are filled from empty; else they are added to. With the insertion in a
    function of its own, or the arrays taken out of the tuples further down, it takes 1.5 times as
    long: numba counts references at every call.
    """
    x, y, z, rows, low, high, lowest, depth, _ = target
    from_x, from_y, from_z, from_rows = source.x, source.y, source.z, source.rows
    queried, state, min_state, indices, squared = search
    n, k, leaves = len(x), indices.shape[1], 1 << depth
    near, near_squared = np.empty((LEAF_POINTS, k), np.int32), np.empty((LEAF_POINTS, k))
    queries, box = np.empty(LEAF_POINTS, np.int64), np.empty((2, 3))
    stack, gaps = np.empty(64, np.int64), np.empty(64)
    buffer = np.empty(LEAF_POINTS)
    for leaf in range(first, last):
        count, worst, last_row = 0, 0.0, -1
        start = (leaf * len(from_x)) >> source.depth
        end = ((leaf + 1) * len(from_x)) >> source.depth
        for position in range(start, end):
            row = from_rows[position]
            if queried[row]:
                queries[count] = position
                for slot in range(k):
                    near[count, slot] = -1 if same_tree else indices[row, slot]
                    near_squared[count, slot] = np.inf if same_tree else squared[row, slot]
                worst = max(worst, near_squared[count, k - 1])
                last_row = max(last_row, near[count, k - 1])
                count += 1
        if count == 0:
            continue
        bound(from_x, from_y, from_z, queries, count, box)
        # Descend: the own leaf first, then the nearer child first.
        stack[0], gaps[0], top = 1, 0.0, 1
        if same_tree:
            stack[1], gaps[1], top = leaves + leaf, 0.0, 2
        own_leaf_left = same_tree
        while top > 0:
            top -= 1
            node = stack[top]
            if gaps[top] > worst or (same_tree and node == leaves + leaf and not own_leaf_left):
                continue
            if gaps[top] == worst and lowest[node] > last_row:
                continue  # ties go to lower rows; without this, all equal points would be visited
            if node < leaves:
                top = descend(low, high, node, box, worst, stack, gaps, top)
                continue
            own_leaf_left = False
            start, end = ((node - leaves) * n) >> depth, ((node - leaves + 1) * n) >> depth
            worst, last_row = 0.0, -1
            for q in range(count):
                here = queries[q]
                px, py, pz, query = from_x[here], from_y[here], from_z[here], from_rows[here]
                limit = near_squared[q, k - 1]
                dx = max(0.0, low[node, 0] - px, px - high[node, 0])
                dy = max(0.0, low[node, 1] - py, py - high[node, 1])
                dz = max(0.0, low[node, 2] - pz, pz - high[node, 2])
                if dx * dx + dy * dy + dz * dz <= limit:
                    for t in range(end - start):
                        dx, dy, dz = x[start + t] - px, y[start + t] - py, z[start + t] - pz
                        buffer[t] = dx * dx + dy * dy + dz * dz
                    for t in range(end - start):
                        d = buffer[t]
                        if d <= limit:
                            candidate = rows[start + t]
                            if candidate == query or state[candidate] < min_state:
                                continue
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
                worst, last_row = max(worst, limit), max(last_row, near[q, k - 1])
        for q in range(count):
            row = from_rows[queries[q]]
            for slot in range(k):
                indices[row, slot], squared[row, slot] = near[q, slot], near_squared[q, slot]
        source.reach[leaf] = np.inf


@kernel
def _set_reach(first, last, source, search):
    """Set the reach of leaves first to last where it is unknown."""
    last_slot = search.squared.shape[1] - 1
    for leaf in range(first, last):
        if source.reach[leaf] < np.inf:
            continue
        reach = 0.0
        start = (leaf * len(source.rows)) >> source.depth
        end = ((leaf + 1) * len(source.rows)) >> source.depth
        for position in range(start, end):
            row = source.rows[position]
            if search.state[row] > 0:
                reach = max(reach, search.squared[row, last_slot])
        source.reach[leaf] = reach
