"""The dendrogram of the merging: which unions made which segments, and at which edges."""

from typing import NamedTuple

import numpy as np

from ellipseg_ros.core.edge_sorting import EDGE
from ellipseg_ros.core.jit import kernel
from ellipseg_ros.core.rows import Renumbering, row_map
from ellipseg_ros.records import Array

NONE = -1  # no parent, no child, no segment


class Dendrogram(NamedTuple):
    """Nodes: vertex v is node v, unions stand from `capacity` on. Arrays (2 capacity,) by node."""

    moments: Array  # MOMENTS, of the graph: initial ellipsoids, then unions
    value: Array  # float64: what the criterion carries along, see criteria.initial_values
    distance: Array  # float64: of a union: D(a, b) of its parts
    parent: Array  # int32
    left: Array  # int32: children, side a and side b; NONE in a vertex or a free node
    right: Array
    made: Array  # EDGE: the edge at which the union was made
    ancestor: Array  # int32: an ancestor made before the current edge, or the node itself
    segment: Array  # int32: row of the last segmentation of which this was the root, else NONE
    root: Array  # (capacity,) int32, by vertex: its root in the last segmentation
    active: Array  # (capacity,) bool, by vertex: its edges are to be tested
    free: Array  # (capacity + 1,) int32: stack of free unions; the last entry is its size


def new_dendrogram(moments: Array) -> Dendrogram:
    """The dendrogram without unions; moments (2 capacity,), which the graph fills."""
    size = len(moments)
    capacity = size // 2
    unions = np.arange(size - 1, capacity - 1, -1)  # the lowest one is on top
    return Dendrogram(
        moments=moments,
        value=np.empty(size),
        distance=np.empty(size),
        parent=np.full(size, NONE, np.int32),
        left=np.full(size, NONE, np.int32),
        right=np.full(size, NONE, np.int32),
        made=np.empty(size, EDGE),
        ancestor=np.arange(size, dtype=np.int32),
        segment=np.full(size, NONE, np.int32),
        root=np.full(capacity, NONE, np.int32),
        active=np.zeros(capacity, bool),
        free=np.append(unions, capacity).astype(np.int32),
    )


def renumber_dendrogram(old: Dendrogram, change: Renumbering, moments: Array) -> Dendrogram:
    """The same unions after the rows of the vertices were renumbered; in place if it has room.

    moments (2 capacity,): of the graph, the vertices moved already.
    """
    size, kept, capacity = len(old.active), change.kept_rows, change.capacity
    new = old if moments is old.moments else new_dendrogram(moments)
    unions = size + np.flatnonzero(old.left[size:] != NONE)
    new_nodes = row_map(kept, 2 * size)
    new_nodes[unions] = unions if new is old else np.arange(capacity, capacity + len(unions))
    _move_nodes(old, kept, unions, new_nodes, new)
    if new is not old:
        new.moments[new_nodes[unions]] = old.moments[unions]
        new.free[-1] = capacity - len(unions)
    new.parent[len(kept) : capacity] = NONE
    new.segment[len(kept) : capacity] = NONE
    new.root[len(kept) :] = NONE
    return new


@kernel
def _move_nodes(old, kept, unions, new_nodes, new):
    """Copy vertices and unions to their new nodes; these ascend, so that it may be in place."""
    _copy(old.value, kept, new_nodes, new.value)
    _copy(old.value, unions, new_nodes, new.value)
    _copy(old.distance, unions, new_nodes, new.distance)
    _copy(old.made, unions, new_nodes, new.made)
    _copy(old.segment, kept, new_nodes, new.segment)
    _copy(old.segment, unions, new_nodes, new.segment)
    _relink(old.root, kept, new_nodes, new.root)
    for node in unions:
        edge = new.made[new_nodes[node]]
        edge.i, edge.j = new_nodes[edge.i], new_nodes[edge.j]
    for link, target in ((old.parent, new.parent), (old.left, new.left), (old.right, new.right)):
        _relink(link, kept, new_nodes, target)
        _relink(link, unions, new_nodes, target)


@kernel
def _copy(column, nodes, new_nodes, target):
    for node in nodes:
        target[new_nodes[node]] = column[node]


@kernel
def _relink(link, nodes, new_nodes, target):
    for node in nodes:
        target[new_nodes[node]] = new_nodes[link[node]]


@kernel
def release(union, dendrogram):
    """Return a union to the stack of free ones."""
    free = dendrogram.free
    dendrogram.parent[union] = dendrogram.left[union] = dendrogram.right[union] = NONE
    dendrogram.segment[union] = NONE
    free[free[-1]] = union
    free[-1] += 1
