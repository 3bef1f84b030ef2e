"""The total order of edges, ascending by (weight, i, j): a radix sort with exact ties."""

from typing import NamedTuple

import numpy as np

from ellipseg_ros.core.jit import THREADS, for_parts, kernel
from ellipseg_ros.data import Array

DIGIT = 11  # bits a pass; three passes take the upper half of a positive float64
BUCKETS = 1 << DIGIT
SHORT = 24  # a run of equal keys up to this length is sorted by insertion


class Edges(NamedTuple):
    """Undirected edges i - j, i < j."""

    weight: Array  # (m,) float64, m, at least 0
    i: Array  # (m,) int32
    j: Array  # (m,) int32


def no_edges(size: int = 0) -> Edges:
    """Room for so many edges."""
    return Edges(np.empty(size), np.empty(size, np.int32), np.empty(size, np.int32))


class Pieces(NamedTuple):
    """Which rows of a list of edges are meant: `count` ones from `start` on, of every piece."""

    start: Array  # (p,) int64
    count: Array  # (p,) int64


def sorted_edges(edges: Edges, pieces: Pieces) -> Edges:
    """The edges of all pieces in ascending order of (weight, i, j).

    Each thread sorts those between two weights: the result is one total order, so the number of
    threads cannot change it.
    """
    size = int(pieces.count.sum())
    parts = [edges.weight[a : a + n] for a, n in zip(*pieces, strict=True)]
    sample = np.sort(np.concatenate([part[:: size // 1024 + 1] for part in parts]))
    cuts = [sample[len(sample) * k // THREADS] for k in range(1, THREADS)] if len(sample) else []
    bounds = np.array([-np.inf, *cuts, np.inf])
    starts = np.array([sum(np.count_nonzero(p < bound) for p in parts) for bound in bounds])
    ascending = no_edges(size)
    threads = [(k, k + 1) for k in range(len(bounds) - 1)]
    for_parts(threads, _sort_between, bounds, starts, edges, pieces, ascending)
    return ascending


@kernel
def _sort_between(part, following, bounds, starts, edges, pieces, ascending):
    weight, i, j = edges
    start, stop = starts[part], starts[following]
    keys, rows = np.empty(stop - start, np.uint32), np.empty(stop - start, np.int32)
    bits = weight.view(np.uint64)
    count = 0
    for piece in range(len(pieces.start)):
        begin = pieces.start[piece]
        for row in range(begin, begin + pieces.count[piece]):
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
    to_weight, to_i, to_j = ascending
    for k in range(count):
        row = rows[k]
        to_weight[start + k], to_i[start + k], to_j[start + k] = weight[row], i[row], j[row]


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
