"""Region growing with memory: Kruskal's walk over the sorted edges, exact and incremental.

The walk of the last update is remembered as a forest (the dendrogram): every union is a node with
its moments and the edge (w, i, j) that made it. A subtree without a dirty or gone vertex *sleeps*:
until the edge that merged it into something else, it would only repeat what it did. So edges
between sleepers are skipped, and a sleeper's state at an edge is its highest ancestor made before.
It wakes at the edge that made its parent, if that parent holds a change, or when an awake segment
merges with it; then the siblings above become sleepers of their own, until *their* parents' edges.
With every vertex dirty this is the plain walk: there is no second code for batch.
A lower threshold refuses some unions, and accepts none that was refused: those above it count as
changes, and everything below them sleeps.
"""

from typing import NamedTuple

import numpy as np

from ellipseg_ros.config import CRITERIA, Config
from ellipseg_ros.core.criteria import density_distance, segment_aicc, shape_distance
from ellipseg_ros.core.disjoint_set import find
from ellipseg_ros.core.ellipsoids import MEAN, unite
from ellipseg_ros.core.events import Events, due, is_before, no_events, pop, push
from ellipseg_ros.core.forest import NONE, Forest, new_forest, release, renumbered_forest
from ellipseg_ros.core.jit import THREADS, for_parts, for_rows, kernel
from ellipseg_ros.core.neighbours import Change
from ellipseg_ros.core.prefetch import prefetch
from ellipseg_ros.core.sorting import Edges
from ellipseg_ros.data import Array

# Numbers for the kernels, in the order of CRITERIA.
SHAPE, DENSITY, PARSIMONY = range(len(CRITERIA))
AHEAD = 8  # edges ahead of the one walked, whose nodes are fetched already
SLABBED = 5_000  # vertices from which on a walk anew is shared between threads
MOST_SLABS = 8  # thinner ones have more edges across than within
NO_UNIONS = np.zeros(0, np.int32)


class Rule(NamedTuple):
    """The criterion in force, in numbers."""

    criterion: int
    tau: float
    floor: float  # m^2
    noise: float  # m^2


class Merged(NamedTuple):
    """The segments of now; s segments."""

    roots: Array  # (s,) int32: rows of the nodes, by the lowest vertex below
    labels: Array  # (rows,) int32: row of `roots` of every vertex, -1 for none
    aicc: Array  # (s,) float64
    before: (
        Array  # (s,) int32: row in the last update of the segment with the same vertices, or -1
    )


class Merge:
    """The forest, from update to update."""

    def __init__(self) -> None:
        self._rule = Rule(-1, 0.0, 0.0, 0.0)  # none yet
        self._lowered = False  # the threshold alone has changed, to a lower one
        self._forest = new_forest(0)

    @property
    def nodes(self) -> Array:
        """(2 capacity, 24) moments; the owner fills the rows of vertices before `update`."""
        return self._forest.nodes

    @property
    def masses(self) -> Array:
        """(2 capacity,) m^2, read by density alone; to be filled likewise."""
        return self._forest.extra

    def renumber(self, keep: Array, capacity: int) -> None:
        """Keep the vertices `keep` (n,) ascending, as 0 to n - 1; see Neighbours.renumber."""
        self._forest = renumbered_forest(self._forest, keep, capacity)

    def widened(self, change: Change, config: Config) -> Array:
        """The dirty vertices; all where the criterion or its numbers have changed.

        A threshold that only became lower makes none dirty: `update` undoes what it refuses.
        """
        rule = Rule(
            CRITERIA.index(config.criterion),
            config.tau,
            config.model.eigenvalue_floor,
            config.model.noise_variance,
        )
        old, self._rule = self._rule, rule
        self._lowered = rule.tau < old.tau and rule._replace(tau=old.tau) == old
        return change.dirty if rule == old or self._lowered else change.member

    def update(self, edges: Edges, change: Change, dirty: Array) -> Merged:
        """Walk the edges; two segments a (i's) and b become one where D(a, b) <= tau.

        dirty: the vertices to begin anew with, as `widened` gave them.
        """
        forest, rule = self._forest, self._rule
        if rule.criterion == PARSIMONY:
            aicc_of(forest.nodes, np.flatnonzero(dirty), rule.noise, forest.extra)
        events = no_events(len(forest.parent) + 1)
        undone = _refused(forest, rule) if self._lowered else NO_UNIONS
        self._lowered = False
        self._begin(dirty, change.gone, undone, events)
        if np.count_nonzero(dirty) > SLABBED and np.array_equal(dirty, change.member):
            dirty = self._walk_slabs(edges, dirty)
            self._begin(dirty, np.zeros_like(dirty), NO_UNIONS, events)
        _walk(forest, edges, rule, events, 1)
        labels = np.full(len(change.member), -1, np.int32)
        roots = np.empty(np.count_nonzero(change.member), np.int32)
        before = np.empty(len(roots), np.int32)
        count = _label(forest, change.member, labels, roots, before)
        roots, before = roots[:count], before[:count]
        forest.segment.fill(NONE)
        forest.segment[roots] = np.arange(count)
        aicc = np.empty(len(forest.parent))
        aicc_of(forest.nodes, roots, rule.noise, aicc)
        return Merged(roots, labels, aicc[roots], before)

    def _begin(self, dirty: Array, gone: Array, undone: Array, events: Events) -> None:
        _begin(self._forest, dirty, gone, undone, events)
        for_rows(_rest, len(self._forest.above), self._forest)

    def _walk_slabs(self, edges: Edges, member: Array) -> Array:
        """Walk the edges within slabs of space, one a thread; returns the ends of the others.

        That is the walk of a graph without the others; with their ends dirty, the whole one is the
        next update. So the slabs change the time, not the result.
        """
        forest, slabs = self._forest, min(THREADS, MOST_SLABS)
        rows = np.flatnonzero(member)
        some = forest.nodes[rows[:: len(rows) // 1024 + 1], MEAN : MEAN + 3]
        axis = np.argmax(np.ptp(some, axis=0))
        cuts = np.quantile(some[:, axis], np.arange(1, slabs) / slabs)
        slab = np.full(len(member), -1, np.int8)
        slab[rows] = np.searchsorted(cuts, forest.nodes[rows, MEAN + axis])
        unions = np.split(forest.free[:-1], np.cumsum(np.bincount(slab[rows], minlength=slabs)))
        forests = [
            forest._replace(awake=slab == k, free=np.append(free, np.int32(len(free))))
            for k, free in enumerate(unions[:slabs])
        ]
        parts = [(k, k + 1) for k in range(slabs)]
        for_parts(parts, self._walk_slab, forests, edges)
        left = [*(f.free[: f.free[-1]] for f in forests), *unions[slabs:]]
        count = sum(map(len, left))
        forest.free[:count], forest.free[-1] = np.concatenate(left), count
        ends = np.zeros(len(member), bool)
        _mark_across(edges, slab, ends)
        return ends

    def _walk_slab(self, k: int, _: int, forests: list[Forest], edges: Edges) -> None:
        _walk(forests[k], edges, self._rule, no_events(0), 2)


@kernel
def _mark_across(edges, slab, ends):
    """Mark the ends of the edges between slabs."""
    left, right = edges[1], edges[2]
    for e in range(len(left)):
        if slab[left[e]] != slab[right[e]]:
            ends[left[e]] = ends[right[e]] = True


@kernel
def _refused(forest, rule):
    """The unions (u,) that the rule would not make."""
    nodes, extra, left, right = forest.nodes, forest.extra, forest.left, forest.right
    criterion, tau = rule.criterion, rule.tau
    refused = np.empty(len(forest.awake), np.int32)
    count = 0
    for union in range(len(forest.awake), len(left)):
        a, b = left[union], right[union]
        if a == NONE:
            continue
        if criterion == SHAPE:
            distance = extra[union]
        elif criterion == DENSITY:
            distance = density_distance(nodes, union, extra[union])
        else:
            distance = extra[union] - extra[a] - extra[b]
        if distance > tau:
            refused[count] = union
            count += 1
    return refused[:count]


@kernel
def _begin(forest, dirty, gone, undone, events):
    """Take down the undone unions and what a dirty or gone vertex is part of; the rest sleeps."""
    parent, left, right = forest.parent, forest.left, forest.right
    made_weight, made_i, made_j = forest.made_weight, forest.made_i, forest.made_j
    awake = forest.awake
    capacity = len(awake)
    broken = np.zeros(capacity, np.bool_)
    count = 0
    unions = np.empty(capacity, np.int32)
    for v in range(capacity):
        awake[v] = dirty[v]
        if dirty[v] or gone[v]:
            up = parent[v]
            parent[v] = NONE
            while up != NONE and not broken[up - capacity]:
                broken[up - capacity] = True
                unions[count] = up
                count += 1
                up = parent[up]
    for up in undone:
        while up != NONE and not broken[up - capacity]:
            broken[up - capacity] = True
            unions[count] = up
            count += 1
            up = parent[up]
    for k in range(count):
        union = unions[k]
        for child in (left[union], right[union]):
            if child >= capacity:
                sleeps = not broken[child - capacity]
            else:
                sleeps = not (dirty[child] or gone[child])
            if sleeps:
                parent[child] = NONE
                push(events, child, made_weight[union], made_i[union], made_j[union])
    for k in range(count):
        release(unions[k], forest)


@kernel
def _rest(start, stop, forest):
    """Let no path be shorter than the dendrogram's: edges begin anew."""
    parent, above = forest.parent, forest.above
    for node in range(start, stop):
        above[node] = node if parent[node] == NONE else parent[node]


@kernel
def _walk(forest, edges, rule, events, ends):  # noqa: PLR0915  # split, it takes 1.5 times as long
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


@kernel
def _label(forest, member, labels, roots, before):
    """Number the segments by their lowest vertex; returns how many there are.

    Most segments are those of the last update: where the root of then is one still, and has not
    been released in the meantime, no path need be climbed.
    """
    above, parent, segment, last = forest.above, forest.parent, forest.segment, forest.root
    row = np.full(len(above), -1, np.int32)
    count = 0
    for v in range(len(member)):
        if not member[v]:
            last[v] = NONE
            continue
        root = last[v]
        if root == NONE or segment[root] == NONE or parent[root] != NONE:
            root = last[v] = find(above, v)
        if row[root] < 0:
            row[root] = count
            roots[count], before[count] = root, segment[root]
            count += 1
        labels[v] = row[root]
    return count


@kernel
def aicc_of(nodes, rows, noise, aicc):
    """Fill aicc[row] for the rows."""
    for k in range(len(rows)):
        aicc[rows[k]] = segment_aicc(nodes, rows[k], noise)
