"""A heap of pairs by cost, of which any may be changed: for merging the best pair first."""

from typing import NamedTuple

import numpy as np

from ellipseg_ros.core.jit import kernel
from ellipseg_ros.data import Array

NOWHERE = -1  # place of a pair that is not in the heap


class Heap(NamedTuple):
    """Numbers 0 to n - 1, ordered by (cost, tie): the least comes first."""

    cost: Array  # (n,) float64
    tie: Array  # (n,) int64
    item: Array  # (n,) int32: the heap itself
    place: Array  # (n,) int32: where in `item` each number is, or NOWHERE
    size: Array  # (1,) int64


def empty_heap(count: int) -> Heap:
    """No number of 0 to count - 1 is in it yet."""
    return Heap(
        cost=np.empty(count),
        tie=np.empty(count, np.int64),
        item=np.empty(count, np.int32),
        place=np.full(count, NOWHERE, np.int32),
        size=np.zeros(1, np.int64),
    )


@kernel
def set_cost(heap, number, cost, tie):
    """Put a number in, or move it, to where its cost belongs."""
    place, size = heap.place, heap.size
    slot = place[number]
    if slot == NOWHERE:
        slot = size[0]
        size[0] += 1
    heap.cost[number], heap.tie[number] = cost, tie
    _sift(number, slot, size[0], heap.cost, heap.tie, heap.item, place)


@kernel
def remove(heap, number):
    """Take out a number that is in."""
    item, place, size = heap.item, heap.place, heap.size
    slot = place[number]
    place[number] = NOWHERE
    size[0] -= 1
    last = item[size[0]]
    if last != number:
        _sift(last, slot, size[0], heap.cost, heap.tie, item, place)


@kernel
def _sift(number, slot, size, cost, tie, item, place):
    """Let a number that takes this slot rise or sink to its own (Williams 1964)."""
    own, second = cost[number], tie[number]
    while slot > 0:
        up = (slot - 1) >> 1
        other = item[up]
        if cost[other] < own or (cost[other] == own and tie[other] <= second):
            break
        item[slot], place[other] = other, slot
        slot = up
    while 2 * slot + 1 < size:
        child = 2 * slot + 1
        other = item[child]
        if child + 1 < size:
            beside = item[child + 1]
            if cost[beside] < cost[other] or (
                cost[beside] == cost[other] and tie[beside] < tie[other]
            ):
                child, other = child + 1, beside
        if own < cost[other] or (own == cost[other] and second <= tie[other]):
            break
        item[slot], place[other] = other, slot
        slot = child
    item[slot], place[number] = number, slot
