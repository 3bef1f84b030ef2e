"""Which segments touch, and along how many edges of the graph."""

import numpy as np

from ellipseg_ros.core.edges import lists
from ellipseg_ros.core.jit import for_parts, kernel
from ellipseg_ros.records import Array, SegmentAdjacency

PARTS = 8  # of the rows, between the threads


def boundaries(neighbours: Array, labels: Array, segments: int) -> SegmentAdjacency:
    """The pairs of segments that edges of the graph join.

    neighbours: (rows, k) int32, -1 for none; labels: (rows,) int32, -1 for no vertex of the graph.
    Row by row, as the edges in their own order lie all over the memory.
    """
    rows, k = len(labels), neighbours.shape[1]
    cuts = np.linspace(0, rows, PARTS + 1).astype(np.int64)
    low, high = np.empty(rows * k, np.int32), np.empty(rows * k, np.int32)
    counts = np.zeros(PARTS, np.int64)
    parts = [(part, part + 1) for part in range(PARTS)]
    for_parts(parts, _crossing, cuts, neighbours, labels, low, high, counts)
    made = SegmentAdjacency(*(np.empty(int(counts.sum()), np.int32) for _ in range(3)))
    count = _tally(cuts * k, counts, low, high, segments, made)
    return SegmentAdjacency(*(column[:count].copy() for column in made))


@kernel
def _crossing(part, following, cuts, neighbours, labels, low, high, counts):
    """Write the two segments, the lower one first, of every edge of a part that joins two.

    An edge belongs to its lower end, or to the end that lists the other, if only one does.
    """
    start = place = cuts[part] * neighbours.shape[1]
    for i in range(cuts[part], cuts[following]):
        a = labels[i]
        if a < 0:
            continue
        for slot in range(neighbours.shape[1]):
            j = neighbours[i, slot]
            if j < 0:
                break
            b = labels[j]
            if a != b and (i < j or not lists(neighbours, j, i)):
                low[place], high[place] = min(a, b), max(a, b)
                place += 1
    counts[part] = place - start


@kernel
def _tally(cuts, counts, low, high, segments, made):
    """Count equal pairs; returns how many different ones there are."""
    ends = np.zeros(segments + 1, np.int64)
    for part in range(len(counts)):
        for place in range(cuts[part], cuts[part] + counts[part]):
            ends[low[place] + 1] += 1
    for a in range(segments):
        ends[a + 1] += ends[a]
    slot = ends.copy()
    others = np.empty(ends[segments], np.int32)  # by lower segment
    for part in range(len(counts)):
        for place in range(cuts[part], cuts[part] + counts[part]):
            others[slot[low[place]]] = high[place]
            slot[low[place]] += 1
    length = np.zeros(segments, np.int32)
    found = 0
    for a in range(segments):
        first = found
        for place in range(ends[a], ends[a + 1]):
            b = others[place]
            if length[b] == 0:
                made.a[found], made.b[found] = a, b
                found += 1
            length[b] += 1
        made.b[first:found].sort()
        for pair in range(first, found):
            made.edge_count[pair] = length[made.b[pair]]
            length[made.b[pair]] = 0
    return found
