"""A heap of pairs by cost, of which any may be changed: for merging the best pair first."""

from typing import NamedTuple

import numpy as np

from ellipseg_ros.core.jit import inlined, kernel
from ellipseg_ros.records import Array

NOWHERE = -1  # place of a pair that is not in the heap


class Heap(NamedTuple):
    """Numbers 0 to n - 1, ordered by (cost, tie): the least comes first."""

    item: Array  # (n,) int32: the heap itself
    cost: Array  # (n,) float64: beside `item`, where the search for a slot finds it
    tie: Array  # (n,) int64, by number
    place: Array  # (n,) int32: where in `item` each number is, or NOWHERE
    size: Array  # (1,) int64


def empty_heap(count: int) -> Heap:
    """No number of 0 to count - 1 is in it yet."""
    return Heap(
        item=np.empty(count, np.int32),
        cost=np.empty(count),
        tie=np.empty(count, np.int64),
        place=np.full(count, NOWHERE, np.int32),
        size=np.zeros(1, np.int64),
    )


@inlined
def set_cost(heap, number, cost, tie):
    """Put a number in, or move it, to where its cost belongs."""
    place, size = heap.place, heap.size
    slot = place[number]
    if slot == NOWHERE:
        slot = size[0]
        size[0] += 1
    heap.tie[number] = tie
    _sift(number, cost, slot, size[0], heap)


@kernel
def remove(heap, number):
    """Take out a number that is in."""
    item, place, size = heap.item, heap.place, heap.size
    slot = place[number]
    place[number] = NOWHERE
    size[0] -= 1
    last = item[size[0]]
    if last != number:
        _sift(last, heap.cost[size[0]], slot, size[0], heap)


@inlined
def _sift(number, own, slot, size, heap):
    """Let a number of cost `own` that takes this slot rise or sink to its own (Williams 1964)."""
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
        beside = child + 1
        if beside < size and (
            cost[beside] < cost[child]
            or (cost[beside] == cost[child] and tie[item[beside]] < tie[item[child]])
        ):
            child = beside
        if own < cost[child] or (own == cost[child] and tie[number] <= tie[item[child]]):
            break
        item[slot], cost[slot] = item[child], cost[child]
        place[item[slot]] = slot
        slot = child
    item[slot], cost[slot], place[number] = number, own, slot
