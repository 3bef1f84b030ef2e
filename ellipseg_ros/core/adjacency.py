"""Which segments are adjacent, and along how many edges of the point graph."""

import numpy as np

from ellipseg_ros.core.contingency import contingency
from ellipseg_ros.core.edges import lists
from ellipseg_ros.core.jit import for_parts, kernel
from ellipseg_ros.records import Array, SegmentAdjacency

PARTS = 8  # of the rows, shared between the threads


def segment_adjacency(neighbours: Array, labels: Array, segments: int) -> SegmentAdjacency:
    """Pairs of segments that edges of the point graph join.

    neighbours: (rows, k) int32, -1 for none; labels: (rows,) int32, -1 for a row that is no
    vertex. Goes through the graph by rows, since the sorted edges are scattered over the memory.
    """
    rows, k = len(labels), neighbours.shape[1]
    cuts = np.linspace(0, rows, PARTS + 1).astype(np.int64)
    low, high = np.empty(rows * k, np.int32), np.empty(rows * k, np.int32)
    counts = np.zeros(PARTS, np.int64)
    parts = [(part, part + 1) for part in range(PARTS)]
    for_parts(parts, _crossing_edges, cuts, neighbours, labels, low, high, counts)
    used = [slice(k * cuts[part], k * cuts[part] + counts[part]) for part in range(PARTS)]
    a, b = (np.concatenate([ends[part] for part in used]) for ends in (low, high))
    table = contingency(a, b, (segments, segments))
    return SegmentAdjacency(table.rows, table.columns, table.counts.astype(np.int32))


@kernel
def _crossing_edges(part, following, cuts, neighbours, labels, low, high, counts):
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
