"""A heap of cached subtrees by the edge at which they become active, in the order of the edges."""

import math
from typing import NamedTuple

import numpy as np

from ellipseg_ros.core.edge_sorting import comes_before
from ellipseg_ros.core.jit import kernel
from ellipseg_ros.records import Array

WAKEUP = np.dtype((np.record, [("weight", "f8"), ("i", "i4"), ("j", "i4"), ("node", "i4")]))


class WakeupHeap(NamedTuple):
    """A binary heap of nodes by edge."""

    entries: Array  # (capacity,) WAKEUP
    size: Array  # (1,) int64


def empty_wakeup_heap(capacity: int) -> WakeupHeap:
    """An empty heap with room for `capacity` nodes."""
    return WakeupHeap(np.empty(capacity, WAKEUP), np.zeros(1, np.int64))


@kernel
def next_weight(heap):
    """Weight of the edge at which the first node becomes active; infinite if there is none."""
    return heap.entries[0].weight if heap.size[0] > 0 else math.inf


@kernel
def due(heap, weight, i, j):
    """Whether a node becomes active at the edge (weight, i, j) or before."""
    if heap.size[0] == 0:
        return False
    first = heap.entries[0]
    return not comes_before(weight, i, j, first.weight, first.i, first.j)


@kernel
def push(heap, node, edge):
    """Add a node that becomes active at an edge (EDGE)."""
    entries, slot = heap.entries, heap.size[0]
    heap.size[0] += 1
    while slot > 0:
        up = entries[(slot - 1) >> 1]
        if not comes_before(edge.weight, edge.i, edge.j, up.weight, up.i, up.j):
            break
        entries[slot] = up
        slot = (slot - 1) >> 1
    entry = entries[slot]
    entry.weight, entry.i, entry.j, entry.node = edge.weight, edge.i, edge.j, node


@kernel
def pop(heap):
    """Remove the node that becomes active first, and return it."""
    entries, first = heap.entries, heap.entries[0].node
    heap.size[0] -= 1
    size = heap.size[0]
    last = entries[size]
    slot, child = 0, 1
    while child < size:
        entry = entries[child]
        if child + 1 < size:
            other = entries[child + 1]
            if comes_before(other.weight, other.i, other.j, entry.weight, entry.i, entry.j):
                child, entry = child + 1, other
        if not comes_before(entry.weight, entry.i, entry.j, last.weight, last.i, last.j):
            break
        entries[slot] = entry
        slot, child = child, 2 * child + 1
    entries[slot] = last
    return first
