"""The graph's edges: each once, weighted, in the order in which they are walked."""

import math
from typing import NamedTuple

import numpy as np

from ellipseg_ros.core.ellipsoids import AXES, MEAN, PLANARITY
from ellipseg_ros.core.jit import THREADS, for_parts, kernel
from ellipseg_ros.core.neighbours import Change
from ellipseg_ros.core.sorting import sorted_order
from ellipseg_ros.data import Array

PARTS = 8  # of the rows or of the edges, between the threads


class Edges(NamedTuple):
    """Undirected edges i - j, i < j, ascending by (weight, i, j)."""

    weight: Array  # (m,) float64, m
    i: Array  # (m,) int32
    j: Array  # (m,) int32


class Renewed(NamedTuple):
    """What the kernels read; arrays by row."""

    neighbours: Array  # (rows, k) int32, -1 for none
    nodes: Array  # (rows and more, 24): initial ellipsoids
    dirty: Array  # (rows,) bool
    stays: Array  # (rows,) bool: members before and now, and not dirty

    @classmethod
    def after(cls, change: Change, neighbours: Array, nodes: Array) -> "Renewed":
        """What a change of the graph leaves to do."""
        return cls(neighbours, nodes, change.dirty, change.member & ~change.dirty)


def no_edges() -> Edges:
    """No edges at all."""
    return Edges(np.zeros(0), np.zeros(0, np.int32), np.zeros(0, np.int32))


def renumbered(edges: Edges, keep: Array) -> Edges:
    """The edges when the rows `keep` (n,) ascending have become 0 to n - 1; all ends are kept."""
    names = np.zeros(int(keep.max(initial=-1)) + 1, np.int32)
    names[keep] = np.arange(len(keep))
    return Edges(edges.weight, names[edges.i], names[edges.j])


def update_edges(edges: Edges, renewed: Renewed) -> Edges:
    """Edges i - j where i in N(j) or j in N(i), with those at dirty rows made anew.

    The kept ones stay sorted; the new ones are sorted and merged into them.
    """
    kept, touched = _keep(edges, renewed)
    added = _added(touched, renewed)
    order = sorted_order(*added)
    added = Edges(*(column[order] for column in added))
    if not len(kept.weight):
        return added
    return _merge_sorted(kept, added)


def _keep(edges: Edges, renewed: Renewed) -> tuple[Edges, Edges]:
    """The edges that stay as they are, and those that one end of still makes, sorted each."""
    size = len(edges.weight)
    cuts = np.array([size * part // PARTS for part in range(PARTS + 1)])
    kept, touched = _empty(size), _empty(size)
    counts = np.zeros((2, PARTS), np.int64)
    parts = [(part, part + 1) for part in range(PARTS)]
    for_parts(parts, _sift, cuts, edges, renewed, kept, touched, counts)
    return _joined(kept, cuts, counts[0]), _joined(touched, cuts, counts[1])


def _added(touched: Edges, renewed: Renewed) -> Edges:
    """The edges with a dirty end."""
    rows = np.flatnonzero(renewed.dirty)
    k = renewed.neighbours.shape[1]
    cuts = np.array([len(rows) * part // PARTS for part in range(PARTS + 1)])
    counts = np.zeros(PARTS, np.int64)
    found = _empty(len(rows) * k)
    parts = [(part, part + 1) for part in range(PARTS)]
    for_parts(parts, _find, cuts, rows, renewed, found, counts)
    found = _joined(found, cuts * k, counts)
    return Edges(*(np.concatenate(columns) for columns in zip(touched, found, strict=True)))


def _merge_sorted(one: Edges, other: Edges) -> Edges:
    """Two sorted lists without a common edge as one: the places of the shorter are looked up."""
    size = len(other.weight)
    cuts = np.array([size * part // THREADS for part in range(THREADS + 1)])
    parts = [(part, part + 1) for part in range(THREADS)]
    places = np.full(size + 1, len(one.weight))
    merged = _empty(len(one.weight) + size)
    for_parts(parts, _look_up, cuts, one, other, places)
    for_parts(parts, _interleave, cuts, one, other, places, merged)
    return merged


def _empty(size: int) -> Edges:
    return Edges(np.empty(size), np.empty(size, np.int32), np.empty(size, np.int32))


def _joined(edges: Edges, starts: Array, counts: Array) -> Edges:
    """The first `counts` edges of every part, which begins at `starts`."""
    pieces = [slice(a, a + n) for a, n in zip(starts, counts, strict=False)]
    return Edges(*(np.concatenate([column[piece] for piece in pieces]) for column in edges))


@kernel
def _sift(part, following, cuts, edges, renewed, kept, touched, counts):
    """Split a part of the edges: both ends stay; a clean end has the dirty one in its list."""
    weight, left, right = edges
    neighbours, nodes, dirty, stays = renewed
    kept_weight, kept_left, kept_right = kept
    touched_weight, touched_left, touched_right = touched
    place = other = cuts[part]
    for e in range(cuts[part], cuts[following]):
        i, j = left[e], right[e]
        if stays[i] and stays[j]:
            kept_weight[place], kept_left[place], kept_right[place] = weight[e], i, j
            place += 1
        elif (stays[i] and dirty[j] and _lists(neighbours, i, j)) or (
            stays[j] and dirty[i] and _lists(neighbours, j, i)
        ):
            touched_weight[other] = edge_weight(nodes, i, j)
            touched_left[other], touched_right[other] = i, j
            other += 1
    counts[0, part], counts[1, part] = place - cuts[part], other - cuts[part]


@kernel
def _lists(neighbours, row, other):
    """Whether `other` is among the neighbours of `row`."""
    for slot in range(neighbours.shape[1]):
        if neighbours[row, slot] == other:
            return True
    return False


@kernel
def _find(part, following, cuts, rows, renewed, edges, counts):
    """The edges that the dirty rows of one part make: those to rows that stay and do not list
    them (the others are in touch with an old edge), to later dirty ones, and to earlier dirty ones
    that do not list them."""
    weight, left, right = edges
    neighbours, nodes, dirty, stays = renewed
    k = neighbours.shape[1]
    place = cuts[part] * k
    for which in range(cuts[part], cuts[following]):
        v = rows[which]
        for slot in range(k):
            other = neighbours[v, slot]
            if other < 0:
                break
            if (stays[other] or other < v) and _lists(neighbours, other, v):
                continue
            left[place], right[place] = min(v, other), max(v, other)
            weight[place] = edge_weight(nodes, left[place], right[place])
            place += 1
    counts[part] = place - cuts[part] * k


@kernel
def edge_weight(nodes, i, j):
    """Initial weight of an edge, m: the gap, more across a plane and between tilted ones.

    The paper gives words only [choice: DESIGN 2.5].
    """
    dx = nodes[j, MEAN] - nodes[i, MEAN]
    dy = nodes[j, MEAN + 1] - nodes[i, MEAN + 1]
    dz = nodes[j, MEAN + 2] - nodes[i, MEAN + 2]
    gap = math.sqrt(dx * dx + dy * dy + dz * dz)
    ix, iy, iz = nodes[i, AXES + 6], nodes[i, AXES + 7], nodes[i, AXES + 8]
    jx, jy, jz = nodes[j, AXES + 6], nodes[j, AXES + 7], nodes[j, AXES + 8]
    cosine = ix * jx + iy * jy + iz * jz
    tilt = max(0.0, 1.0 - cosine * cosine)
    across = (abs(ix * dx + iy * dy + iz * dz) + abs(jx * dx + jy * dy + jz * dz)) / 2.0
    planarity = (nodes[i, PLANARITY] + nodes[j, PLANARITY]) / 2.0
    return gap + planarity * (gap * tilt + across)


@kernel
def _look_up(part, following, cuts, one, other, places):
    """How many edges of `one` come before each of the part's edges of `other`."""
    weight, left, right = one
    other_weight, other_left, other_right = other
    low = 0
    for e in range(cuts[part], cuts[following]):
        w, i, j = other_weight[e], other_left[e], other_right[e]
        step = 1  # doubled, as the next place is near
        while low + step < len(weight) and _before(weight, left, right, low + step, w, i, j):
            low += step
            step *= 2
        high = min(low + step, len(weight))
        while low < high:
            middle = (low + high) >> 1
            if _before(weight, left, right, middle, w, i, j):
                low = middle + 1
            else:
                high = middle
        places[e] = low


@kernel
def _before(weight, left, right, e, w, i, j):
    """Whether edge e comes before the edge i - j of weight w."""
    if weight[e] != w:
        return weight[e] < w
    if left[e] != i:
        return left[e] < i
    return right[e] < j


@kernel
def _interleave(part, following, cuts, one, other, places, merged):
    """Copy the part's edges of `other`, each after those of `one` that come before it."""
    weight, left, right = merged
    one_weight, one_left, one_right = one
    other_weight, other_left, other_right = other
    size = len(other_weight)
    start = places[cuts[part] - 1] if cuts[part] > 0 else 0
    for e in range(cuts[part], cuts[following] + (cuts[following] == size)):
        for k in range(start, places[e]):
            weight[k + e], left[k + e], right[k + e] = one_weight[k], one_left[k], one_right[k]
        start = places[e]
        if e < size:
            k = start + e
            weight[k], left[k], right[k] = other_weight[e], other_left[e], other_right[e]
