"""Binary heap of numbered items by cost, of which any can be changed or removed."""

from typing import NamedTuple

import numpy as np

from ellipseg_ros.core.jit import inlined, kernel
from ellipseg_ros.records import Array

NOWHERE = -1  # place of an item that is not in the heap


class Heap(NamedTuple):
    """Items 0 to n - 1, ordered by (cost, tie): the smallest comes first."""

    item: Array  # (n,) int32: the heap itself
    cost: Array  # (n,) float64: beside `item`, where the search for a slot reads it
    tie: Array  # (n,) int64, by item
    place: Array  # (n,) int32: where in `item` each one is, or NOWHERE
    size: Array  # (1,) int64


def empty_heap(count: int) -> Heap:
    """A heap without any of the items 0 to count - 1."""
    return Heap(
        item=np.empty(count, np.int32),
        cost=np.empty(count),
        tie=np.empty(count, np.int64),
        place=np.full(count, NOWHERE, np.int32),
        size=np.zeros(1, np.int64),
    )


@inlined
def set_cost(heap, number, cost, tie):
    """Insert an item, or move it to where its new cost belongs."""
    place, size = heap.place, heap.size
    slot = place[number]
    if slot == NOWHERE:
        slot = size[0]
        size[0] += 1
    heap.tie[number] = tie
    _sift(number, cost, slot, size[0], heap)


@kernel
def remove(heap, number):
    """Remove an item if it is in the heap."""
    item, place, size = heap.item, heap.place, heap.size
    slot = place[number]
    if slot == NOWHERE:
        return
    place[number] = NOWHERE
    size[0] -= 1
    last = item[size[0]]
    if last != number:
        _sift(last, heap.cost[size[0]], slot, size[0], heap)


@inlined
def _sift(number, own, slot, size, heap):
    """Move an item of cost `own` from a slot up or down to its place (Williams 1964)."""
    item, cost, tie, place = heap.item, heap.cost, heap.tie, heap.place
    while slot > 0:
        up = (slot - 1) >> 1
        if cost[up] < own or (cost[up] == own and tie[item[up]] <= tie[number]):
            break
        item[slot], cost[slot] = item[up], cost[up]
        place[item[slot]] = slot
        slot = up
    while 2 * slot + 1 < size:
        child = 2 * slot + 1
        other = child + 1
        if other < size and (
            cost[other] < cost[child]
            or (cost[other] == cost[child] and tie[item[other]] < tie[item[child]])
        ):
            child = other
        if own < cost[child] or (own == cost[child] and tie[number] <= tie[item[child]]):
            break
        item[slot], cost[slot] = item[child], cost[child]
        place[item[slot]] = slot
        slot = child
    item[slot], cost[slot], place[number] = number, own, slot
