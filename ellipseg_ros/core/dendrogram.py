"""The dendrogram of the merging: which unions made which segments, and by which edges."""

from typing import NamedTuple

import numpy as np

from ellipseg_ros.core.ellipsoids import WIDTH
from ellipseg_ros.core.jit import kernel
from ellipseg_ros.records import Array

NONE = -1  # no parent, no child


class Forest(NamedTuple):
    """Nodes: vertex v is node v, unions stand from `capacity` on. Arrays by node."""

    nodes: Array  # (2 capacity, 24) float64: moments, see ellipsoids
    extra: Array  # float64: mass (density), AICc (parsimony) or, of a union, its D (shape)
    parent: Array  # int32
    left: Array  # int32: children, side a and side b; NONE in a vertex or a free node
    right: Array
    made_weight: Array  # float64: the edge that made the union
    made_i: Array  # int32
    made_j: Array
    above: Array  # int32: some ancestor made before the edge walked now, or the node itself
    segment: Array  # int32: row of the last segmentation of which this was the root, else NONE
    root: Array  # (capacity,) int32: by vertex: the root over it in that segmentation
    awake: Array  # (capacity,) bool: by vertex
    free: Array  # (capacity + 1,) int32: unions not in use; the last entry counts them


def new_forest(capacity: int) -> Forest:
    """No unions yet; the owner fills the rows of the vertices."""
    size = 2 * capacity
    unions = np.arange(size - 1, capacity - 1, -1)  # the lowest one is on top
    return Forest(
        nodes=np.empty((size, WIDTH)),
        extra=np.empty(size),
        parent=np.full(size, NONE, np.int32),
        left=np.full(size, NONE, np.int32),
        right=np.full(size, NONE, np.int32),
        made_weight=np.empty(size),
        made_i=np.empty(size, np.int32),
        made_j=np.empty(size, np.int32),
        above=np.arange(size, dtype=np.int32),
        segment=np.full(size, NONE, np.int32),
        root=np.full(capacity, NONE, np.int32),
        awake=np.zeros(capacity, bool),
        free=np.append(unions, capacity).astype(np.int32),
    )


def renumbered_forest(old: Forest, keep: Array, capacity: int) -> Forest:
    """The forest of the vertices `keep` (n,) ascending, as 0 to n - 1; in place if it has room."""
    size = len(old.awake)
    forest = old if size == capacity else new_forest(capacity)
    names = np.full(2 * size + 1, NONE, np.int32)  # node -1 is the last: none stays none
    names[keep] = np.arange(len(keep))
    unions = size + np.flatnonzero(old.left[size:] != NONE)
    kept = unions if forest is old else np.arange(capacity, capacity + len(unions))
    names[unions] = kept
    _move_forest(old, keep, unions, names, forest)
    forest.parent[len(keep) : capacity] = NONE
    forest.segment[len(keep) : capacity] = NONE
    forest.root[len(keep) :] = NONE
    if forest is not old:
        forest.free[-1] = capacity - len(unions)
    return forest


@kernel
def _move_forest(old, keep, unions, names, new):
    """Copy the vertices `keep` and the unions to where `names` says: ascending, maybe in place."""
    _copy(old.extra, keep, names, new.extra)
    _copy(old.extra, unions, names, new.extra)
    _copy(old.made_weight, unions, names, new.made_weight)
    _copy(old.segment, keep, names, new.segment)
    _copy(old.segment, unions, names, new.segment)
    _relink(old.root, keep, names, new.root)
    for link, other in ((old.made_i, new.made_i), (old.made_j, new.made_j)):
        _relink(link, unions, names, other)
    for link, other in ((old.parent, new.parent), (old.left, new.left), (old.right, new.right)):
        _relink(link, keep, names, other)
        _relink(link, unions, names, other)
    nodes, new_nodes = old.nodes, new.nodes
    for which in (keep, unions):
        for k in range(len(which)):
            for column in range(nodes.shape[1]):
                new_nodes[names[which[k]], column] = nodes[which[k], column]


@kernel
def _copy(column, which, names, new):
    for k in range(len(which)):
        new[names[which[k]]] = column[which[k]]


@kernel
def _relink(link, which, names, new):
    for k in range(len(which)):
        new[names[which[k]]] = names[link[which[k]]]


@kernel
def release(union, forest):
    """Take a union out of use."""
    free = forest.free
    forest.parent[union] = forest.left[union] = forest.right[union] = NONE
    forest.segment[union] = NONE
    free[free[-1]] = union
    free[-1] += 1
