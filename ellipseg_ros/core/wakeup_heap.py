"""A heap of cached subtrees by the edge at which they become active, in the order of the edges."""

from typing import NamedTuple

import numpy as np

from ellipseg_ros.core.edge_sorting import comes_before
from ellipseg_ros.core.jit import inlined, kernel
from ellipseg_ros.records import Array


class WakeupHeap(NamedTuple):
    """A binary heap: entry `slot` is the node `node[slot]` with the edge (weight, i, j)."""

    weight: Array
    i: Array
    j: Array
    node: Array
    size: Array  # (1,) int64


def empty_wakeup_heap(capacity: int) -> WakeupHeap:
    """An empty heap with room for `capacity` nodes."""
    return WakeupHeap(
        weight=np.empty(capacity),
        i=np.empty(capacity, np.int32),
        j=np.empty(capacity, np.int32),
        node=np.empty(capacity, np.int32),
        size=np.zeros(1, np.int64),
    )


@kernel
def due(heap, weight, i, j):
    """Whether a node becomes active at the edge (weight, i, j) or before."""
    return heap.size[0] > 0 and not comes_before(
        weight, i, j, heap.weight[0], heap.i[0], heap.j[0]
    )


@kernel
def push(heap, node, weight, i, j):
    """Add a node that becomes active at the edge (weight, i, j)."""
    slot = heap.size[0]
    heap.size[0] += 1
    while slot > 0:
        up = (slot - 1) >> 1
        if not comes_before(weight, i, j, heap.weight[up], heap.i[up], heap.j[up]):
            break
        _move(heap, up, slot)
        slot = up
    heap.weight[slot], heap.i[slot], heap.j[slot], heap.node[slot] = weight, i, j, node


@kernel
def pop(heap):
    """Remove the node that becomes active first, and return it."""
    first = heap.node[0]
    heap.size[0] -= 1
    size = heap.size[0]
    weight, i, j, node = heap.weight[size], heap.i[size], heap.j[size], heap.node[size]
    slot, child = 0, 1
    while child < size:
        other = child + 1
        if other < size and comes_before(
            heap.weight[other],
            heap.i[other],
            heap.j[other],
            heap.weight[child],
            heap.i[child],
            heap.j[child],
        ):
            child = other
        if not comes_before(heap.weight[child], heap.i[child], heap.j[child], weight, i, j):
            break
        _move(heap, child, slot)
        slot, child = child, 2 * child + 1
    heap.weight[slot], heap.i[slot], heap.j[slot], heap.node[slot] = weight, i, j, node
    return first


@inlined
def _move(heap, source, slot):
    heap.weight[slot], heap.i[slot] = heap.weight[source], heap.i[source]
    heap.j[slot], heap.node[slot] = heap.j[source], heap.node[source]
