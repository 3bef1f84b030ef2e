"""The dendrogram of the merging: which unions made which segments, and at which edges."""

from typing import NamedTuple

import numpy as np

from ellipseg_ros.core.edge_sorting import EDGE
from ellipseg_ros.core.jit import kernel
from ellipseg_ros.core.rows import row_map
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


def renumber_dendrogram(old: Dendrogram, kept: Array, moments: Array) -> Dendrogram:
    """The same unions after the rows of the vertices were renumbered; in place if it has room.

    kept (n,), ascending: the rows that are 0 to n - 1 now; moments (2 capacity,): of the graph,
    the vertices moved already.
    """
    size, capacity = len(old.active), len(moments) // 2
    new = old if moments is old.moments else new_dendrogram(moments)
    unions = size + np.flatnonzero(old.left[size:] != NONE)
    places = unions if new is old else np.arange(capacity, capacity + len(unions))
    new_nodes = row_map(kept, 2 * size)
    new_nodes[unions] = places
    if new is not old:
        new.moments[places] = old.moments[unions]
        new.free[-1] = capacity - len(unions)
    new.distance[places], new.made[places] = old.distance[unions], old.made[unions]
    for end in ("i", "j"):
        new.made[end][places] = new_nodes[new.made[end][places]]
    nodes, targets = np.append(kept, unions), np.append(np.arange(len(kept)), places)
    new.value[targets], new.segment[targets] = old.value[nodes], old.segment[nodes]
    for link, target in ((old.parent, new.parent), (old.left, new.left), (old.right, new.right)):
        target[targets] = new_nodes[link[nodes]]
    new.root[: len(kept)] = new_nodes[old.root[kept]]
    new.parent[len(kept) : capacity] = NONE
    new.segment[len(kept) : capacity] = NONE
    new.root[len(kept) :] = NONE
    return new


@kernel
def release(union, dendrogram):
    """Return a union to the stack of free ones."""
    free = dendrogram.free
    dendrogram.parent[union] = dendrogram.left[union] = dendrogram.right[union] = NONE
    dendrogram.segment[union] = NONE
    free[free[-1]] = union
    free[-1] += 1
