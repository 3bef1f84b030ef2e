"""Region growing with memory: Kruskal's algorithm over the sorted edges, exact and incremental.

The run of the last update is kept as a dendrogram: every union is a node with its moments and the
edge (w, i, j) at which it was made. A subtree without a dirty or removed vertex is *cached*: up to
the edge at which its parent was made, a new run would only repeat it. So edges between cached
subtrees are skipped, and the state of a cached subtree at an edge is its highest ancestor made
before. It becomes *active* at the edge at which its parent was made, if that parent holds a change
(a *wake-up*), or when an active segment merges with it (an *invalidation*); then the siblings
above it become cached subtrees of their own, until the edges of *their* parents.
With every vertex dirty this is the plain algorithm: there is no second code for batch.
A lower threshold refuses some unions and accepts none that was refused: the unions above it count
as changes, and everything below them stays cached.
"""

from typing import NamedTuple

import numpy as np

from ellipseg_ros.core.criteria import Rule, initial_values, segments_aicc
from ellipseg_ros.core.dendrogram import (
    NONE,
    Dendrogram,
    new_dendrogram,
    release,
    renumber_dendrogram,
)
from ellipseg_ros.core.disjoint_set import find
from ellipseg_ros.core.edge_sorting import Edges
from ellipseg_ros.core.graph import Graph, GraphChange
from ellipseg_ros.core.jit import THREADS, for_parts, for_rows, kernel
from ellipseg_ros.core.kruskal import kruskal
from ellipseg_ros.core.moments import no_moments
from ellipseg_ros.core.wakeup_heap import WakeupHeap, empty_wakeup_heap, push
from ellipseg_ros.records import Array

SLAB_MIN_VERTICES = 5_000  # from this number of vertices on a full run is shared between threads
MAX_SLABS = 8  # thinner slabs have more edges across than within


class Merged(NamedTuple):
    """The segments after an update; s segments."""

    roots: Array  # (s,) int32: rows of the graph's moments, by the lowest vertex below
    labels: Array  # (rows,) int32: row of `roots` of every vertex, -1 for none
    aicc: Array  # (s,) float64
    previous: Array  # (s,) int32: row of the same vertices' segment in the last update, or -1


class Merge:
    """Merges the vertices of a graph to segments; keeps the dendrogram from update to update."""

    def __init__(self) -> None:
        self._rule = Rule(-1, 0.0, 0.0, 0.0)  # none yet
        self._dendrogram = new_dendrogram(no_moments())

    def update(self, graph: Graph, change: GraphChange, rule: Rule) -> Merged:
        """Segments of `graph` after `change`: a and b merge where D(a, b) <= rule.threshold."""
        if change.kept_rows is not None:
            self._dendrogram = renumber_dendrogram(
                self._dendrogram, change.kept_rows, graph.moments
            )
        dendrogram, last, self._rule = self._dendrogram, self._rule, rule
        not_raised = rule._replace(threshold=max(rule.threshold, last.threshold))
        dirty = change.dirty if last == not_raised else change.member
        in_use = dendrogram.left != NONE
        refused = np.flatnonzero(in_use & (dendrogram.distance > rule.threshold))
        rows = np.flatnonzero(dirty)
        initial_values(
            rule, graph.points, graph.knn_indices, graph.moments, rows, dendrogram.value
        )
        heap = empty_wakeup_heap(len(dendrogram.parent) + 1)
        _begin_update(dendrogram, dirty, change.removed, refused, heap)
        if len(rows) > SLAB_MIN_VERTICES and np.array_equal(dirty, change.member):
            across = self._merge_within_slabs(graph.edges, rows)
            none = np.zeros_like(dirty)
            _begin_update(dendrogram, across, none, np.zeros(0, np.int64), heap)
        kruskal(dendrogram, graph.edges, rule, heap, 1)
        return _merged(dendrogram, change.member, rule)

    def _merge_within_slabs(self, edges: Edges, rows: Array) -> Array:
        """Run Kruskal's algorithm within slabs of space, a thread each.

        rows: the vertices. Returns the ends of the edges across slabs, (rows,) bool. The result
        is that of the graph without these edges; with their ends dirty, that of the whole graph
        is the next update. So the slabs change the time, not the result.
        """
        dendrogram, slabs = self._dendrogram, min(THREADS, MAX_SLABS)
        means = dendrogram.moments["mean"]
        sample = means[rows[:: len(rows) // 1024 + 1]]
        axis = np.argmax(np.ptp(sample, axis=0))
        cuts = np.quantile(sample[:, axis], np.arange(1, slabs) / slabs)
        slab = np.full(len(dendrogram.active), -1, np.int8)
        slab[rows] = np.searchsorted(cuts, means[rows, axis])
        unions = np.split(
            dendrogram.free[:-1], np.cumsum(np.bincount(slab[rows], minlength=slabs))
        )
        parts = [
            dendrogram._replace(active=slab == k, free=np.append(free, np.int32(len(free))))
            for k, free in enumerate(unions[:slabs])
        ]
        for_parts([(k, k + 1) for k in range(slabs)], self._merge_slab, parts, edges)
        left = [*(part.free[: part.free[-1]] for part in parts), *unions[slabs:]]
        count = sum(map(len, left))
        dendrogram.free[:count], dendrogram.free[-1] = np.concatenate(left), count
        across = np.zeros(len(slab), bool)
        _mark_across(edges, slab, across)
        return across

    def _merge_slab(self, k: int, _: int, parts: list[Dendrogram], edges: Edges) -> None:
        kruskal(parts[k], edges, self._rule, empty_wakeup_heap(0), 2)


def _begin_update(
    dendrogram: Dendrogram, dirty: Array, removed: Array, refused: Array, heap: WakeupHeap
) -> None:
    """Release the refused unions and those above dirty or removed vertices; cache the rest."""
    changed = np.append(dirty | removed, np.zeros(len(dirty), bool))  # by node
    above = np.append(dendrogram.parent[changed], refused)
    dendrogram.parent[changed] = NONE
    dendrogram.active[:] = dirty
    _release_changed(dendrogram, changed, above, heap)
    for_rows(_reset_ancestors, len(dendrogram.ancestor), dendrogram)


def _merged(dendrogram: Dendrogram, member: Array, rule: Rule) -> Merged:
    """Number the segments, and note their roots in the dendrogram for the next update."""
    labels = np.full(len(member), -1, np.int32)
    roots = np.empty(np.count_nonzero(member), np.int32)
    previous = np.empty(len(roots), np.int32)
    count = _label(dendrogram, member, labels, roots, previous)
    roots, previous = roots[:count], previous[:count]
    dendrogram.segment.fill(NONE)
    dendrogram.segment[roots] = np.arange(count)
    aicc = np.empty(len(dendrogram.parent))
    segments_aicc(dendrogram.moments, roots, rule.noise_variance, aicc)
    return Merged(roots, labels, aicc[roots], previous)


@kernel
def _mark_across(edges, slab, across):
    """Mark the ends of the edges between slabs."""
    for e in range(len(edges.i)):
        if slab[edges.i[e]] != slab[edges.j[e]]:
            across[edges.i[e]] = across[edges.j[e]] = True


@kernel
def _release_changed(dendrogram, changed, above, heap):
    """Release the unions `above` and all above these; mark them changed. Cache their other parts.

    changed: by node, the vertices marked already.
    """
    parent, left, right = dendrogram.parent, dendrogram.left, dendrogram.right
    unions = np.empty(len(dendrogram.active), np.int32)
    count = 0
    for union in above:
        while union != NONE and not changed[union]:
            changed[union] = True
            unions[count] = union
            count += 1
            union = parent[union]
    for union in unions[:count]:
        for child in (left[union], right[union]):
            if not changed[child]:
                parent[child] = NONE
                push(heap, child, dendrogram.made[union])
    for union in unions[:count]:
        release(union, dendrogram)


@kernel
def _reset_ancestors(start, stop, dendrogram):
    """Undo all path compression: the edges begin again."""
    parent, ancestor = dendrogram.parent, dendrogram.ancestor
    for node in range(start, stop):
        ancestor[node] = node if parent[node] == NONE else parent[node]


@kernel
def _label(dendrogram, member, labels, roots, previous):
    """Number the segments by their lowest vertex; returns how many there are.

    Most segments are those of the last update: where the root of a vertex then is still a root and
    has not been released in the meantime, no path is followed.
    """
    ancestor, parent = dendrogram.ancestor, dendrogram.parent
    segment, last_root = dendrogram.segment, dendrogram.root
    row = np.full(len(ancestor), -1, np.int32)
    count = 0
    for v in range(len(member)):
        if not member[v]:
            last_root[v] = NONE
            continue
        root = last_root[v]
        if root == NONE or segment[root] == NONE or parent[root] != NONE:
            root = last_root[v] = find(ancestor, v)
        if row[root] < 0:
            row[root] = count
            roots[count], previous[count] = root, segment[root]
            count += 1
        labels[v] = row[root]
    return count
