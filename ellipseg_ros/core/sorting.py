"""The total order of edges, ascending by (weight, i, j): a radix sort with exact ties."""

import numpy as np

from ellipseg_ros.core.jit import THREADS, for_parts, kernel
from ellipseg_ros.data import Array

DIGIT = 11  # bits a pass; three passes take the upper half of a positive float64
BUCKETS = 1 << DIGIT
SHORT = 24  # a run of equal keys up to this length is sorted by insertion


def sorted_order(weight: Array, i: Array, j: Array) -> Array:
    """(m,) int32: the rows in ascending order of (weight, i, j); weight (m,) float64, at least 0.

    Each thread sorts the rows between two weights: the result is one total order, so the number of
    threads cannot change it.
    """
    sample = np.sort(weight[:: max(1, len(weight) // 1024)])
    cuts = [sample[len(sample) * k // THREADS] for k in range(1, THREADS)] if len(sample) else []
    bounds = np.array([-np.inf, *cuts, np.inf])
    sizes = np.array([np.count_nonzero(weight < bound) for bound in bounds])
    sizes[-1] = len(weight)
    order = np.empty(len(weight), np.int32)
    parts = [(k, k + 1) for k in range(len(bounds) - 1)]
    for_parts(parts, _sort_between, bounds, sizes, weight, i, j, order)
    return order


@kernel
def _sort_between(part, following, bounds, sizes, weight, i, j, order):
    start, stop = sizes[part], sizes[following]
    keys, rows = np.empty(stop - start, np.uint32), np.empty(stop - start, np.int32)
    bits = weight.view(np.uint64)
    count = 0
    for row in range(len(weight)):
        if bounds[part] <= weight[row] < bounds[following]:
            keys[count], rows[count] = bits[row] >> 32, row
            count += 1
    _radix(keys, rows)
    first = 0
    for last in range(1, count + 1):
        if last == count or keys[last] != keys[first]:
            if 1 < last - first <= SHORT:
                _insertion(rows, first, last, weight, i, j)
            elif last - first > SHORT:
                _heap(rows[first:last], weight, i, j)
            first = last
    order[start:stop] = rows


@kernel
def _radix(keys, rows):
    """Sort both by the keys, least digit first."""
    tally = np.zeros((3, BUCKETS), np.int64)
    for t in range(len(keys)):
        for digit in range(3):
            tally[digit, (keys[t] >> (digit * DIGIT)) & (BUCKETS - 1)] += 1
    other_keys, other_rows = np.empty_like(keys), np.empty_like(rows)
    for digit in range(3):
        place = 0
        for bucket in range(BUCKETS):
            here = tally[digit, bucket]
            tally[digit, bucket] = place
            place += here
        for t in range(len(keys)):
            bucket = (keys[t] >> (digit * DIGIT)) & (BUCKETS - 1)
            place = tally[digit, bucket]
            tally[digit, bucket] = place + 1
            other_keys[place], other_rows[place] = keys[t], rows[t]
        keys[:], rows[:] = other_keys, other_rows


@kernel
def before(a, b, weight, i, j):
    """Whether row a comes before row b."""
    if weight[a] != weight[b]:
        return weight[a] < weight[b]
    if i[a] != i[b]:
        return i[a] < i[b]
    return j[a] < j[b]


@kernel
def _insertion(rows, first, last, weight, i, j):
    for t in range(first + 1, last):
        row = rows[t]
        slot = t
        while slot > first and before(row, rows[slot - 1], weight, i, j):
            rows[slot] = rows[slot - 1]
            slot -= 1
        rows[slot] = row


@kernel
def _heap(rows, weight, i, j):
    """Heap sort (Williams 1964): no worse on many equal keys, as duplicate points make."""
    size = len(rows)
    build = size // 2
    while size > 1:
        if build > 0:
            build -= 1
            parent = build
        else:
            size -= 1
            rows[0], rows[size] = rows[size], rows[0]
            parent = 0
        row = rows[parent]
        child = 2 * parent + 1
        while child < size:
            if child + 1 < size and before(rows[child], rows[child + 1], weight, i, j):
                child += 1
            if not before(row, rows[child], weight, i, j):
                break
            rows[parent] = rows[child]
            parent, child = child, 2 * child + 1
        rows[parent] = row
