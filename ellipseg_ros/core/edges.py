"""The graph's edges: each once, weighted, in the order in which they are walked."""

import math
from typing import NamedTuple

import numpy as np

from ellipseg_ros.core.edge_sorting import EDGE, Edges, Pieces, no_edges, sorted_edges
from ellipseg_ros.core.ellipsoids import MEAN, PLANARITY, V3
from ellipseg_ros.core.jit import for_parts, kernel
from ellipseg_ros.core.neighbours import Change
from ellipseg_ros.records import Array

PARTS = 8  # of the rows or of the edges, between the threads
STAYS, DIRTY = 1, 2  # status of a row: a member before and now with the same neighbours, or not


class Renewed(NamedTuple):
    """What the kernels read; arrays by row."""

    neighbours: Array  # (rows, k) int32, -1 for none
    nodes: Array  # (rows and more, 24): initial ellipsoids
    status: Array  # (rows,) uint8: STAYS, DIRTY, or 0: no member now

    @classmethod
    def after(cls, change: Change, neighbours: Array, nodes: Array) -> "Renewed":
        """What a change of the graph leaves to do."""
        status = np.where(change.dirty, np.uint8(DIRTY), change.member.astype(np.uint8))
        return cls(neighbours, nodes, status)


def renumbered(edges: Edges, keep: Array) -> Edges:
    """The edges when the rows `keep` (n,) ascending have become 0 to n - 1; all ends are kept."""
    names = np.zeros(int(keep.max(initial=-1)) + 1, np.int32)
    names[keep] = np.arange(len(keep))
    return Edges(edges.weight, names[edges.i], names[edges.j])


def update_edges(edges: Edges, renewed: Renewed) -> Edges:
    """Edges i - j where i in N(j) or j in N(i), with those at dirty rows made anew.

    The new ones are sorted and then merged into those that stay, which are sorted already.
    """
    size, rows = len(edges.weight), np.flatnonzero(renewed.status == DIRTY)
    k = renewed.neighbours.shape[1]
    cuts, row_cuts = (np.linspace(0, n, PARTS + 1).astype(np.int64) for n in (size, len(rows)))
    # By clean rows at a dirty end, then by dirty ones.
    made = np.empty(size + len(rows) * k, EDGE)
    pieces = Pieces(
        np.concatenate([cuts[:-1], size + k * row_cuts[:-1]]), np.zeros(2 * PARTS, np.int64)
    )
    stays, kept = np.empty(size, bool), np.zeros(PARTS, np.int64)
    parts = [(part, part + 1) for part in range(PARTS)]
    for_parts(parts, _sift, cuts, edges, renewed, stays, kept, made, pieces)
    for_parts(parts, _find, row_cuts, rows, renewed, made, pieces)
    added = sorted_edges(made, pieces)
    return _merged(edges, stays, cuts, kept, added) if kept.any() else added


def _merged(edges: Edges, stays: Array, cuts: Array, counts: Array, added: Edges) -> Edges:
    """Those of `edges` that stay (`counts` between the `cuts`) and the added, sorted both."""
    before = np.concatenate([[0], np.cumsum(counts)])
    first = np.array([_place(edges, cut, added) for cut in cuts])
    first[0], first[-1] = 0, len(added.weight)
    merged = no_edges(int(before[-1]) + len(added.weight))
    parts = [(part, part + 1) for part in range(PARTS)]
    for_parts(parts, _interleave, cuts, edges, stays, before, first, added, merged)
    return merged


def _place(edges: Edges, e: int, added: Edges) -> int:
    """How many of the added edges come before edge e."""
    if e == len(edges.weight):
        return len(added.weight)
    key = (edges.weight[e], edges.i[e], edges.j[e])
    place, end = (int(np.searchsorted(added.weight, key[0], side)) for side in ("left", "right"))
    while place < end and (added.weight[place], added.i[place], added.j[place]) < key:
        place += 1
    return place


@kernel
def _sift(  # noqa: PLR0913  # the ninth argument would only be hidden in a tuple
    part, following, cuts, edges, renewed, kept, counts, made, pieces
):
    """Tell which edges of a part stay, and make those that a clean end has to the dirty one."""
    weight, left, right = edges
    neighbours, nodes, status = renewed
    start = place = pieces.start[part]
    count = 0
    for e in range(cuts[part], cuts[following]):
        i, j = left[e], right[e]
        kept[e] = status[i] & status[j] & STAYS
        count += kept[e]
        if status[i] + status[j] == STAYS + DIRTY and (
            lists(neighbours, i, j) if status[i] == STAYS else lists(neighbours, j, i)
        ):
            made[place]["weight"] = edge_weight(nodes, i, j)
            made[place]["i"], made[place]["j"] = i, j
            place += 1
    counts[part], pieces.count[part] = count, place - start


@kernel
def lists(neighbours, row, other):
    """Whether `other` is among the neighbours of `row`."""
    for slot in range(neighbours.shape[1]):
        if neighbours[row, slot] == other:
            return True
    return False


@kernel
def _find(part, following, cuts, rows, renewed, made, pieces):
    """Make the edges that the dirty rows of one part own: those to rows that stay and do not list
    them (the others are in touch with an old edge), to later dirty ones, and to earlier dirty ones
    that do not list them."""
    neighbours, nodes, status = renewed
    k = neighbours.shape[1]
    start = place = pieces.start[PARTS + part]
    for which in range(cuts[part], cuts[following]):
        v = rows[which]
        for slot in range(k):
            other = neighbours[v, slot]
            if other < 0:
                break
            if (status[other] == STAYS or other < v) and lists(neighbours, other, v):
                continue
            i, j = min(v, other), max(v, other)
            made[place]["weight"] = edge_weight(nodes, i, j)
            made[place]["i"], made[place]["j"] = i, j
            place += 1
    pieces.count[PARTS + part] = place - start


@kernel
def edge_weight(nodes, i, j):
    """Initial weight of an edge, m: the gap, more across a plane and between tilted ones.

    The paper gives words only [choice: DESIGN 2.5].
    """
    dx = nodes[j, MEAN] - nodes[i, MEAN]
    dy = nodes[j, MEAN + 1] - nodes[i, MEAN + 1]
    dz = nodes[j, MEAN + 2] - nodes[i, MEAN + 2]
    gap = math.sqrt(dx * dx + dy * dy + dz * dz)
    ix, iy, iz = nodes[i, V3], nodes[i, V3 + 1], nodes[i, V3 + 2]
    jx, jy, jz = nodes[j, V3], nodes[j, V3 + 1], nodes[j, V3 + 2]
    cosine = ix * jx + iy * jy + iz * jz
    tilt = max(0.0, 1.0 - cosine * cosine)
    across = (abs(ix * dx + iy * dy + iz * dz) + abs(jx * dx + jy * dy + jz * dz)) / 2.0
    planarity = (nodes[i, PLANARITY] + nodes[j, PLANARITY]) / 2.0
    return gap + planarity * (gap * tilt + across)


@kernel
def _interleave(  # noqa: PLR0913  # likewise
    part, following, cuts, edges, kept, before, first, added, merged
):
    """Write the part's edges that stay, and the added ones from first[part] on, in their order."""
    weight, left, right = merged
    old_weight, old_left, old_right = edges
    new_weight, new_left, new_right = added
    new, end = first[part], first[following]
    place = before[part] + new
    for e in range(cuts[part], cuts[following]):
        if not kept[e]:
            continue
        w, i, j = old_weight[e], old_left[e], old_right[e]
        while new < end and (
            new_weight[new] < w
            or (
                new_weight[new] == w
                and (new_left[new] < i or (new_left[new] == i and new_right[new] < j))
            )
        ):
            weight[place], left[place], right[place] = (
                new_weight[new],
                new_left[new],
                new_right[new],
            )
            new += 1
            place += 1
        weight[place], left[place], right[place] = w, i, j
        place += 1
    for rest in range(new, end):
        weight[place], left[place], right[place] = (
            new_weight[rest],
            new_left[rest],
            new_right[rest],
        )
        place += 1
