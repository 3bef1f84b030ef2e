"""Balanced kd-trees, searched for the k nearest neighbours of many points at a time.

Ours rather than a library's, since a neighbour list must be exact to the last tie: ascending
(d^2, row) with d^2 = (dx^2 + dy^2) + dz^2 in float64. A box's distance is computed by the same
monotonic operations, so it is never above that of a point inside, and pruning loses nothing.
All points of a leaf walk down the tree together.
"""

from typing import NamedTuple

import numpy as np

from ellipseg_ros.core.jit import for_parts, kernel
from ellipseg_ros.data import Array

LEAF = 24  # most points a leaf


class Tree(NamedTuple):
    """Nodes are numbered like a heap, root 1; node q of level d holds the positions
    q n >> d to (q + 1) n >> d of the points, which lie in the order of the leaves."""

    x: Array  # (n,) float64
    y: Array
    z: Array
    rows: Array  # (n,) int32: the row of the point
    low: Array  # (nodes, 3) float64: corners of the nodes' boxes
    high: Array
    first: Array  # (nodes,) int32: the lowest row of a node; equal points lie in that order
    depth: int  # level of the leaves
    reach: (
        Array  # (leaves,) float64, m^2: no point of a leaf has a neighbour farther; inf: unknown
    )


class Search(NamedTuple):
    """Whose neighbours are wanted among whom, and where they go; arrays by row."""

    wanted: Array  # (rows,) bool
    status: Array  # (rows,) uint8
    least: int  # only points of at least this status are neighbours
    found: Array  # (rows, k) int32, ascending by (d^2, row), never the point itself; -1 for none
    squared: Array  # (rows, k) float64, m^2; inf for none


def build(points: Array, rows: Array) -> Tree:
    """Tree of points[rows]; points (r, 3) float64, finite, rows (n,) int."""
    count = len(rows)
    depth = max(0, int(np.ceil(np.log2(max(count, 1) / LEAF))))
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


def nearest(trees: list[Tree], search: Search) -> None:
    """Fill the wanted rows of `found` and `squared`; every point is in one of the trees."""
    for source in trees:
        for target in (source, *(tree for tree in trees if tree is not source)):
            for_parts(_leaf_parts(source), _nearest, source, target, target is source, search)
        for_parts(_leaf_parts(source), _measure, source, search)


def gaining(trees: list[Tree], entering: Tree, search: Search) -> Array:
    """(rows,) bool: the wanted rows to which an entering point is nearer than their last one."""
    gains = np.zeros(len(search.wanted), bool)
    if len(entering.rows):
        for source in trees:
            for_parts(_leaf_parts(source), _gaining, source, entering, search, gains)
    return gains


def losing(trees: list[Tree], leaving: Tree, search: Search) -> Array:
    """(rows,) bool: the wanted rows that lack a neighbour, or have one below the least status.

    leaving: the points that have sunk below it since the wanted rows were searched.
    """
    loses = np.zeros(len(search.wanted), bool)
    for source in trees:
        for_parts(_leaf_parts(source), _losing, source, leaving, search, loses)
    return loses


def _leaf_parts(tree: Tree) -> list[tuple[int, int]]:
    leaves = 1 << tree.depth
    parts = 8 if leaves > 64 else 1
    return [(leaves * k // parts, leaves * (k + 1) // parts) for k in range(parts)]


@kernel
def _split(node, stop, table, depth, low, high, first):
    """Order `table` below `node` down to the level before `stop`; set the boxes met."""
    stack = [node]
    while len(stack) > 0:
        node = stack.pop()
        level = 0
        while (node >> level) > 1:
            level += 1
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
def _nearest(first, last, source, target, own, search):  # noqa: PLR0915  # see below
    """The neighbours in `target` of the points in the leaves first to last of `source`.

    own: the trees are the same one, and the lists begin anew; else they are added to. With the
    insertion in a function of its own, or the arrays taken out of the tuples further down, it
    takes 1.5 times as long: numba counts references at every call.
    """
    x, y, z, rows, low, high, lowest, depth, _ = target
    from_x, from_y, from_z, from_rows = source.x, source.y, source.z, source.rows
    wanted, status, least, found, squared = search
    n, k, leaves = len(x), found.shape[1], 1 << depth
    near, near_squared = np.empty((LEAF, k), np.int32), np.empty((LEAF, k))
    queries, box = np.empty(LEAF, np.int64), np.empty((2, 3))
    stack, gaps = np.empty(64, np.int64), np.empty(64)
    buffer = np.empty(LEAF)
    for leaf in range(first, last):
        count, worst, last_row = 0, 0.0, -1
        start = (leaf * len(from_x)) >> source.depth
        end = ((leaf + 1) * len(from_x)) >> source.depth
        for position in range(start, end):
            row = from_rows[position]
            if wanted[row]:
                queries[count] = position
                for slot in range(k):
                    near[count, slot] = -1 if own else found[row, slot]
                    near_squared[count, slot] = np.inf if own else squared[row, slot]
                worst = max(worst, near_squared[count, k - 1])
                last_row = max(last_row, near[count, k - 1])
                count += 1
        if count == 0:
            continue
        _bound(from_x, from_y, from_z, queries, count, box)
        # Down the tree: the own leaf first, then always the nearer child.
        stack[0], gaps[0], top = 1, 0.0, 1
        if own:
            stack[1], gaps[1], top = leaves + leaf, 0.0, 2
        fresh = own
        while top > 0:
            top -= 1
            node = stack[top]
            if gaps[top] > worst or (own and node == leaves + leaf and not fresh):
                continue
            if gaps[top] == worst and lowest[node] > last_row:
                continue  # no nearer, and ties go to lower rows: equal points would be all met
            if node < leaves:
                top = _descend(low, high, node, box, worst, stack, gaps, top)
                continue
            fresh = False
            start, end = ((node - leaves) * n) >> depth, ((node - leaves + 1) * n) >> depth
            worst, last_row = 0.0, -1
            for q in range(count):
                here = queries[q]
                px, py, pz, me = from_x[here], from_y[here], from_z[here], from_rows[here]
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
                            if candidate == me or status[candidate] < least:
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
                found[row, slot], squared[row, slot] = near[q, slot], near_squared[q, slot]
        source.reach[leaf] = np.inf


@kernel
def _measure(first, last, source, search):
    """Set the reach of the leaves first to last, where it is unknown."""
    last_slot = search.squared.shape[1] - 1
    for leaf in range(first, last):
        if source.reach[leaf] < np.inf:
            continue
        reach = 0.0
        start = (leaf * len(source.rows)) >> source.depth
        end = ((leaf + 1) * len(source.rows)) >> source.depth
        for position in range(start, end):
            row = source.rows[position]
            if search.status[row] > 0:
                reach = max(reach, search.squared[row, last_slot])
        source.reach[leaf] = reach


@kernel
def _gaining(first, last, source, entering, search, gains):
    """Mark the wanted points in the leaves first to last that an entering point comes near."""
    x, y, z, rows, low, high, lowest, depth, _ = entering
    from_x, from_y, from_z, from_rows = source.x, source.y, source.z, source.rows
    wanted, _, _, found, squared = search
    n, k, leaves = len(x), found.shape[1], 1 << depth
    queries, box = np.empty(LEAF, np.int64), np.empty((2, 3))
    stack, gaps = np.empty(64, np.int64), np.empty(64)
    for leaf in range(first, last):
        if not _comes_near(entering, source, leaf, box, stack, gaps):
            continue
        count, reach, last_row = 0, 0.0, -1
        start = (leaf * len(from_x)) >> source.depth
        end = ((leaf + 1) * len(from_x)) >> source.depth
        for position in range(start, end):
            row = from_rows[position]
            if wanted[row]:
                queries[count] = position
                reach = max(reach, squared[row, k - 1])
                last_row = max(last_row, found[row, k - 1])
                count += 1
        if count == 0:
            continue
        _bound(from_x, from_y, from_z, queries, count, box)
        stack[0], gaps[0], top = 1, 0.0, 1
        while top > 0:
            top -= 1
            node = stack[top]
            if gaps[top] == reach and lowest[node] > last_row:
                continue
            if node < leaves:
                top = _descend(low, high, node, box, reach, stack, gaps, top)
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
                        d == squared[row, k - 1] and rows[other] < found[row, k - 1]
                    ):
                        gains[row] = True
                        break


@kernel
def _losing(first, last, source, leaving, search, loses):
    """Mark the wanted points in the leaves first to last that have lost a neighbour."""
    wanted, status, least, found, _ = search
    box, stack, gaps = np.empty((2, 3)), np.empty(64, np.int64), np.empty(64)
    for leaf in range(first, last):
        if not _comes_near(leaving, source, leaf, box, stack, gaps):
            continue
        start = (leaf * len(source.rows)) >> source.depth
        end = ((leaf + 1) * len(source.rows)) >> source.depth
        for position in range(start, end):
            row = source.rows[position]
            if wanted[row]:
                for slot in range(found.shape[1]):
                    if found[row, slot] < 0 or status[found[row, slot]] < least:
                        loses[row] = True
                        break


@kernel
def _comes_near(other, source, leaf, box, stack, gaps):
    """Whether a point of the other tree may be, or have been, a neighbour of one in the leaf."""
    reach, node = source.reach[leaf], (1 << source.depth) + leaf
    if reach == np.inf:
        return True
    for axis in range(3):
        box[0, axis], box[1, axis] = source.low[node, axis], source.high[node, axis]
    leaves = 1 << other.depth
    stack[0], top = 1, 1
    while top > 0:
        top -= 1
        node = stack[top]
        if node >= leaves:
            if _gap(other.low, other.high, node, box) <= reach:
                return True
            continue
        top = _descend(other.low, other.high, node, box, reach, stack, gaps, top)
    return False


@kernel
def _bound(x, y, z, queries, count, box):
    """Corners of the box around some positions."""
    for axis in range(3):
        box[0, axis], box[1, axis] = np.inf, -np.inf
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
