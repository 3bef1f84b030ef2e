"""A heap of nodes by the edge at which they wake, in the order of the edges."""

from typing import NamedTuple

import numpy as np

from ellipseg_ros.core.jit import kernel
from ellipseg_ros.records import Array


class Events(NamedTuple):
    """A heap of nodes by the edge at which they wake."""

    weight: Array
    i: Array
    j: Array
    node: Array
    size: Array  # (1,) int64


def no_events(capacity: int) -> Events:
    """An empty heap with room for so many."""
    return Events(
        weight=np.empty(capacity),
        i=np.empty(capacity, np.int32),
        j=np.empty(capacity, np.int32),
        node=np.empty(capacity, np.int32),
        size=np.zeros(1, np.int64),
    )


@kernel
def is_before(w, i, j, other_w, other_i, other_j):
    """Whether the edge (w, i, j) comes before the other."""
    if w != other_w:
        return w < other_w
    if i != other_i:
        return i < other_i
    return j < other_j


@kernel
def due(events, w, i, j):
    """Whether a node wakes at the edge (w, i, j) or before."""
    return events.size[0] > 0 and not is_before(
        w, i, j, events.weight[0], events.i[0], events.j[0]
    )


@kernel
def push(events, node, w, i, j):
    """Let a node wake at the edge (w, i, j)."""
    weight, left, right, nodes = events.weight, events.i, events.j, events.node
    slot = events.size[0]
    events.size[0] += 1
    while slot > 0:
        up = (slot - 1) >> 1
        if not is_before(w, i, j, weight[up], left[up], right[up]):
            break
        weight[slot], left[slot], right[slot], nodes[slot] = (
            weight[up],
            left[up],
            right[up],
            nodes[up],
        )
        slot = up
    weight[slot], left[slot], right[slot], nodes[slot] = w, i, j, node


@kernel
def pop(events):
    """The node that wakes first; it is taken out."""
    weight, left, right, nodes = events.weight, events.i, events.j, events.node
    first = nodes[0]
    events.size[0] -= 1
    size = events.size[0]
    w, i, j, node = weight[size], left[size], right[size], nodes[size]
    slot, child = 0, 1
    while child < size:
        other = child + 1
        if other < size and is_before(
            weight[other], left[other], right[other], weight[child], left[child], right[child]
        ):
            child = other
        if not is_before(weight[child], left[child], right[child], w, i, j):
            break
        weight[slot], left[slot], right[slot], nodes[slot] = (
            weight[child],
            left[child],
            right[child],
            nodes[child],
        )
        slot, child = child, 2 * child + 1
    weight[slot], left[slot], right[slot], nodes[slot] = w, i, j, node
    return first
