"""The walk over the sorted edges: which segments become one, and which sleepers wake.

See merge, which says what sleeps and why.
"""

from typing import NamedTuple

from ellipseg_ros.config import CRITERIA
from ellipseg_ros.core.criteria import density_distance, segment_aicc, shape_distance
from ellipseg_ros.core.dendrogram import NONE, release
from ellipseg_ros.core.ellipsoids import unite
from ellipseg_ros.core.jit import kernel
from ellipseg_ros.core.prefetch import prefetch
from ellipseg_ros.core.wakeup_heap import due, is_before, pop, push

# Numbers for the kernels, in the order of CRITERIA.
SHAPE, DENSITY, PARSIMONY = range(len(CRITERIA))
AHEAD = 8  # edges ahead of the one walked, whose nodes are fetched already


class Rule(NamedTuple):
    """The criterion in force, in numbers."""

    criterion: int
    tau: float
    floor: float  # m^2
    noise: float  # m^2


@kernel
def walk(forest, edges, rule, events, ends):  # noqa: PLR0915  # split, it takes 1.5 times as long
    """Test the edges that have at least so many awake ends."""
    weight, edge_i, edge_j = edges
    nodes, extra, awake, free = forest.nodes, forest.extra, forest.awake, forest.free
    above, made_weight = forest.above, forest.made_weight
    made_i, made_j = forest.made_i, forest.made_j
    criterion, tau, floor, noise = rule
    a = b = 0
    e, stop, last = 0, _wake_up(edges, 0, events), len(weight) - 1
    while e <= last:
        if e == stop:
            while due(events, weight[e], edge_i[e], edge_j[e]):
                _wake(pop(events), forest)
            stop = _wake_up(edges, e, events)
        i, j = edge_i[e], edge_j[e]
        e += 1
        if int(awake[i]) + int(awake[j]) < ends:
            continue
        w = weight[e - 1]
        later = min(e + AHEAD, last)
        if int(awake[edge_i[later]]) + int(awake[edge_j[later]]) >= ends:
            for node in (above[edge_i[later]], above[edge_j[later]]):
                prefetch(nodes, node, 0)
                prefetch(nodes, node, 64)
        # Each end's highest ancestor made before this edge. Halving the path to it is allowed,
        # as edges only ascend.
        for side in range(2):
            node = i if side == 0 else j
            while True:
                up = above[node]
                if up == node or not (
                    made_weight[up] < w
                    or is_before(made_weight[up], made_i[up], made_j[up], w, i, j)
                ):
                    break
                higher = above[up]
                if higher == up or not (
                    made_weight[higher] < w
                    or is_before(made_weight[higher], made_i[higher], made_j[higher], w, i, j)
                ):
                    node = up
                    break
                above[node] = higher
                node = higher
            if side == 0:
                a = node
            else:
                b = node
        if a == b:
            continue
        union = free[free[-1] - 1]
        if criterion == SHAPE:
            extra[union] = shape_distance(nodes, a, b, floor, tau)
            if extra[union] > tau:
                continue
            unite(nodes, a, b, union)
        elif criterion == DENSITY:
            unite(nodes, a, b, union)
            extra[union] = extra[a] + extra[b]
            if density_distance(nodes, union, extra[union]) > tau:
                continue
        else:
            unite(nodes, a, b, union)
            extra[union] = segment_aicc(nodes, union, noise)
            if extra[union] - extra[a] - extra[b] > tau:
                continue
        free[-1] -= 1
        if not awake[i]:
            _disturb(a, forest, events)
        if not awake[j]:
            _disturb(b, forest, events)
        if stop > e and due(events, weight[stop - 1], edge_i[stop - 1], edge_j[stop - 1]):
            stop = _wake_up(edges, e, events)
        _join(a, b, union, forest)
        made_weight[union], made_i[union], made_j[union] = w, i, j


@kernel
def _wake_up(edges, start, events):
    """The first edge from `start` on at which an event is due; the number of edges for none.

    By doubling steps and then by halves: events are many, and mostly near.
    """
    weight, left, right = edges
    low, high, step = start, start, 1
    while high < len(weight) and not due(events, weight[high], left[high], right[high]):
        low, high, step = high + 1, high + step, 2 * step
    high = min(high, len(weight))
    while low < high:
        middle = (low + high) >> 1
        if due(events, weight[middle], left[middle], right[middle]):
            high = middle
        else:
            low = middle + 1
    return low


@kernel
def _join(a, b, union, forest):
    forest.left[union], forest.right[union] = a, b
    forest.parent[a] = forest.parent[b] = union
    forest.above[a] = forest.above[b] = union
    forest.parent[union], forest.above[union] = NONE, union


@kernel
def _disturb(node, forest, events):
    """A sleeper's state merges with something awake: it wakes, the rest falls apart.

    The siblings on the way up sleep on, each until the edge that made its parent.
    """
    parent, left, right, above = forest.parent, forest.left, forest.right, forest.above
    _wake(node, forest)
    below, up = node, parent[node]
    parent[node] = NONE
    while up != NONE:
        sibling = right[up] if left[up] == below else left[up]
        parent[sibling], above[sibling] = NONE, sibling
        push(events, sibling, forest.made_weight[up], forest.made_i[up], forest.made_j[up])
        below, higher = up, parent[up]
        release(up, forest)
        up = higher


@kernel
def _wake(node, forest):
    """Mark the vertices below; nothing where the node has been released in the meantime."""
    left, right, awake = forest.left, forest.right, forest.awake
    stack = [node]
    while len(stack) > 0:
        node = stack.pop()
        if node < len(awake):
            awake[node] = True
        elif left[node] != NONE:
            stack.append(left[node])
            stack.append(right[node])
