"""The total order of edges, ascending by (weight, i, j): a radix sort with exact ties."""

from typing import NamedTuple

import numpy as np

from ellipseg_ros.core.jit import THREADS, for_parts, inlined, kernel
from ellipseg_ros.records import Array

DIGIT_BITS = 11  # of a pass; three passes sort by the upper half of a positive float64
BUCKETS = 1 << DIGIT_BITS
EDGES_PER_PART = 100_000  # sorted at a time by a thread: their keys fit its cache


class Edges(NamedTuple):
    """Undirected edges i - j, i < j."""

    weight: Array  # (m,) float64, m, at least 0
    i: Array  # (m,) int32
    j: Array  # (m,) int32


def no_edges(size: int = 0) -> Edges:
    """Arrays for `size` edges."""
    return Edges(np.empty(size), np.empty(size, np.int32), np.empty(size, np.int32))


# An edge before sorting, which moves it once.
EDGE = np.dtype((np.record, [("weight", "f8"), ("i", "i4"), ("j", "i4")]))


class Pieces(NamedTuple):
    """Pieces of a list of edges: `count` rows from `start` on, for each piece."""

    start: Array  # (p,) int64
    count: Array  # (p,) int64


def sorted_edges(made: Array, pieces: Pieces) -> Edges:
    """The edges of all pieces of `made` (EDGE) in ascending order of (weight, i, j).

    The edges are distributed to ranges of weight, which are sorted one by one: the result is a
    total order, so the number of threads cannot change it.
    """
    size = int(pieces.count.sum())
    weights = [made["weight"][a : a + n] for a, n in zip(*pieces, strict=True)]
    sample = np.sort(np.concatenate([part[:: size // 1024 + 1] for part in weights]))
    parts = THREADS * (size // (THREADS * EDGES_PER_PART) + 1) if size else 1
    bounds = sample[np.arange(1, parts) * len(sample) // parts]
    tally = np.zeros((len(weights), parts), np.int64)
    calls = [(k, k + 1) for k in range(len(weights))]
    for_parts(calls, _count, bounds, made, pieces, tally)
    ends = np.cumsum(tally.T).reshape(parts, -1).T  # by part, then by piece
    keys, rows = np.empty(size, np.uint32), np.empty(size, np.int32)
    for_parts(calls, _distribute, bounds, made, pieces, ends - tally, keys, rows)
    ascending = no_edges(size)
    calls = [(end - n, end) for end, n in zip(ends[-1], tally.sum(axis=0), strict=True)]
    for_parts(calls, _sort, keys, rows, made, ascending)
    return ascending


@kernel
def _part(weight, bounds):
    part = 0
    for bound in bounds:
        part += weight >= bound
    return part


@kernel
def _count(piece, _, bounds, made, pieces, tally):
    """Count the edges of one piece by part."""
    begin = pieces.start[piece]
    for row in range(begin, begin + pieces.count[piece]):
        tally[piece, _part(made[row].weight, bounds)] += 1


@kernel
def _distribute(piece, _, bounds, made, pieces, places, keys, rows):
    """Write the upper half of the weights of one piece, and their rows, part by part."""
    begin = pieces.start[piece]
    bits = made.view(np.uint64)  # two an edge
    for row in range(begin, begin + pieces.count[piece]):
        part = _part(made[row].weight, bounds)
        place = places[piece, part]
        places[piece, part] += 1
        keys[place], rows[place] = bits[2 * row] >> 32, row


@kernel
def _sort(start, stop, all_keys, all_rows, made, ascending):
    """Write the edges of one part in their order."""
    keys, rows = all_keys[start:stop], all_rows[start:stop]
    _radix(keys, rows)
    first, count = 0, stop - start
    for last in range(1, count + 1):
        if last == count or keys[last] != keys[first]:
            if last - first > 1:
                _heap_sort(rows[first:last], made)
            first = last
    weight, i, j = ascending
    for k in range(count):
        edge, place = made[rows[k]], start + k
        weight[place], i[place], j[place] = edge.weight, edge.i, edge.j


@kernel
def _radix(keys, rows):
    """Sort both by the keys, least digit first."""
    tally = np.zeros((3, BUCKETS), np.int64)
    for t in range(len(keys)):
        for digit in range(3):
            tally[digit, (keys[t] >> (digit * DIGIT_BITS)) & (BUCKETS - 1)] += 1
    other_keys, other_rows = np.empty_like(keys), np.empty_like(rows)
    for digit in range(3):
        place = 0
        for bucket in range(BUCKETS):
            here = tally[digit, bucket]
            tally[digit, bucket] = place
            place += here
        for t in range(len(keys)):
            bucket = (keys[t] >> (digit * DIGIT_BITS)) & (BUCKETS - 1)
            place = tally[digit, bucket]
            tally[digit, bucket] = place + 1
            other_keys[place], other_rows[place] = keys[t], rows[t]
        keys[:], rows[:] = other_keys, other_rows


@inlined
def comes_before(weight, i, j, other_weight, other_i, other_j):
    """Whether edge (weight, i, j) comes before the other one: the one order of edges."""
    return weight < other_weight or (
        weight == other_weight and (i < other_i or (i == other_i and j < other_j))
    )


@kernel
def _row_before(a, b, made):
    """Whether row a of a list of edges comes before row b."""
    one, other = made[a], made[b]
    return comes_before(one["weight"], one["i"], one["j"], other["weight"], other["i"], other["j"])


@kernel
def _heap_sort(rows, made):
    """Sort by (weight, i, j) in place (Williams 1964): no worse on many equal weights."""
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
            if child + 1 < size and _row_before(rows[child], rows[child + 1], made):
                child += 1
            if not _row_before(row, rows[child], made):
                break
            rows[parent] = rows[child]
            parent, child = child, 2 * child + 1
        rows[parent] = row
