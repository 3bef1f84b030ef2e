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
from ellipseg_ros.core.criteria import density_distance, segment_aicc
from ellipseg_ros.core.dendrogram import NONE, Forest, new_forest, release, renumbered_forest
from ellipseg_ros.core.disjoint_set import find
from ellipseg_ros.core.edge_sorting import Edges
from ellipseg_ros.core.ellipsoids import MEAN
from ellipseg_ros.core.jit import THREADS, for_parts, for_rows, kernel
from ellipseg_ros.core.kruskal import DENSITY, PARSIMONY, SHAPE, Rule, walk
from ellipseg_ros.core.neighbours import Change
from ellipseg_ros.core.wakeup_heap import Events, no_events, push
from ellipseg_ros.records import Array

SLABBED = 5_000  # vertices from which on a walk anew is shared between threads
MOST_SLABS = 8  # thinner ones have more edges across than within
NO_UNIONS = np.zeros(0, np.int32)


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
        walk(forest, edges, rule, events, 1)
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
        walk(forests[k], edges, self._rule, no_events(0), 2)


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
