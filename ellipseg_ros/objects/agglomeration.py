"""Best-first merging of adjacent segments: first into flat unions, then by similarity.

All merges are kept, in order: the hierarchy of objects.
"""

import math
from typing import NamedTuple

import numpy as np

from ellipseg_ros.core.jit import inlined, kernel
from ellipseg_ros.core.linalg.eigen import least_eigenvalue
from ellipseg_ros.core.moments import unite
from ellipseg_ros.objects.indexed_heap import Heap, empty_heap, remove, set_cost
from ellipseg_ros.records import Array, Hierarchy, SegmentAdjacency

NONE = -1


class Groups(NamedTuple):
    """Groups of segments while they merge; a group is named by its lowest segment.

    Every group has a linked list of its pairs: pair p has the links 2 p and 2 p + 1, one in the
    list of either group.
    """

    moments: Array  # (s,) MOMENTS of the points
    features: Array  # (s, f): means over the points
    left: Array  # (p,) int32: the lower group of a pair, NONE for a pair that is no more
    right: Array  # (p,) int32
    edge_count: Array  # (p,) float64: edges of the point graph between the two
    first: Array  # (s,) int32: a link, or NONE
    following: Array  # (2 p,) int32: the next link of the same list
    pair_with: Array  # (s,) int32: for finding pairs that become one; NONE between uses


def merge_segments(
    moments: Array, features: Array, adjacency: SegmentAdjacency, thickness: float
) -> Hierarchy:
    """Merge all segments that are adjacent, directly or through others, the best pair first.

    moments (s,) of the segments' points; features (s, f). As long as there are adjacent groups
    whose union has a standard deviation across of at most `thickness`, m, both weighed equally,
    the thinnest union is made, at no cost. Then the pair of the lowest cost

        n_a n_b / (n_a + n_b) |f_a - f_b|^2 / sqrt(edges between a and b):

    the growth of the squared deviations from the mean features (Ward 1963), by boundary. Ties:
    the lower segments, a before b.
    """
    groups, heap, merges = _start(moments, features, adjacency)
    cost = np.zeros(merges.shape[1])
    flat = _merge_flat(groups, thickness, heap, merges)
    count = _merge_similar(groups, heap, flat, merges, cost)
    return Hierarchy(merges[0, :count], merges[1, :count], cost[:count], len(moments))


def flat_groups(moments: Array, adjacency: SegmentAdjacency, thickness: float) -> Array:
    """The group (s,) int32 of every segment after the flat unions alone.

    moments, thickness: as for `merge_segments`, of which this is the first part.
    """
    groups, heap, merges = _start(moments, np.zeros((len(moments), 0)), adjacency)
    count = _merge_flat(groups, thickness, heap, merges)
    hierarchy = Hierarchy(merges[0, :count], merges[1, :count], np.zeros(count), len(moments))
    return hierarchy.labels_after(count)


def _start(
    moments: Array, features: Array, adjacency: SegmentAdjacency
) -> tuple[Groups, Heap, Array]:
    """Every segment as a group, an empty heap of pairs, and memory for the merges (2, s - 1)."""
    segments, pairs = len(moments), len(adjacency.a)
    groups = Groups(
        moments=moments.copy(),
        features=features.copy(),
        left=adjacency.a.copy(),
        right=adjacency.b.copy(),
        edge_count=adjacency.edge_count.astype(np.float64),
        first=np.full(segments, NONE, np.int32),
        following=np.full(2 * pairs, NONE, np.int32),
        pair_with=np.full(segments, NONE, np.int32),
    )
    _link(groups)
    return groups, empty_heap(pairs), np.empty((2, max(0, segments - 1)), np.int32)


@kernel
def _link(groups):
    for pair in range(len(groups.left)):
        for side in range(2):
            group = groups.left[pair] if side == 0 else groups.right[pair]
            groups.following[2 * pair + side] = groups.first[group]
            groups.first[group] = 2 * pair + side


@kernel
def _merge_flat(groups, thickness, heap, merges):
    """Merge pairs with a flat union, the thinnest first; returns the number of merges."""
    limit = thickness * thickness
    for pair in range(len(groups.left)):
        _offer_flat(groups, pair, limit, heap)
    count = 0
    while heap.size[0] > 0:
        link = _merge_first(groups, heap, merges, count)
        while link != NONE:
            _offer_flat(groups, link >> 1, limit, heap)
            link = groups.following[link]
        count += 1
    return count


@inlined
def _offer_flat(groups, pair, limit, heap):
    """Put a pair into the heap if its union is flat; else remove it."""
    a, b = groups.left[pair], groups.right[pair]
    variance = union_thickness(groups.moments, a, b, limit)
    if variance < math.inf:
        set_cost(heap, pair, variance, (np.int64(a) << 32) + b)
    else:
        remove(heap, pair)


@kernel
def union_thickness(moments, row_a, row_b, limit):
    """Smallest variance of the union of two sets, m^2; infinite if it is above the limit.

    Both weigh the same, however many points they have: beside a wall, a post would weigh nothing.
    """
    a, b = moments[row_a], moments[row_b]
    if a.e3 + b.e3 > 2.0 * limit:
        return math.inf  # a union is no thinner than its parts on average (Weyl)
    dx, dy, dz = b.mean_x - a.mean_x, b.mean_y - a.mean_y, b.mean_z - a.mean_z
    xx = 0.5 * (a.xx + b.xx) + 0.25 * dx * dx
    xy = 0.5 * (a.xy + b.xy) + 0.25 * dx * dy
    xz = 0.5 * (a.xz + b.xz) + 0.25 * dx * dz
    yy = 0.5 * (a.yy + b.yy) + 0.25 * dy * dy
    yz = 0.5 * (a.yz + b.yz) + 0.25 * dy * dz
    zz = 0.5 * (a.zz + b.zz) + 0.25 * dz * dz
    # Above the limit if the matrix less the limit is positive definite (Sylvester): quicker.
    px, py, pz = xx - limit, yy - limit, zz - limit
    minor = px * py - xy * xy
    determinant = pz * minor - px * yz * yz - py * xz * xz + 2 * xy * xz * yz
    if px > 0.0 and minor > 0.0 and determinant > 0:
        return math.inf
    smallest = least_eigenvalue(xx, xy, xz, yy, yz, zz)
    return smallest if smallest <= limit else math.inf


@kernel
def _merge_similar(groups, heap, count, merges, cost):
    """Merge all adjacent groups, the cheapest pair first; continues after `count` merges."""
    for pair in range(len(groups.left)):
        if groups.left[pair] != NONE:
            _offer_similar(groups, pair, heap)
    while heap.size[0] > 0:
        cost[count] = heap.cost[0]
        link = _merge_first(groups, heap, merges, count)
        while link != NONE:
            _offer_similar(groups, link >> 1, heap)
            link = groups.following[link]
        count += 1
    return count


@inlined
def _offer_similar(groups, pair, heap):
    """Put a pair into the heap, or move it to where its cost belongs."""
    a, b = groups.left[pair], groups.right[pair]
    price = ward_cost(groups.moments, groups.features, a, b, groups.edge_count[pair])
    set_cost(heap, pair, price, (np.int64(a) << 32) + b)


@kernel
def ward_cost(moments, features, a, b, edge_count):
    """Growth of the squared deviations from the mean features, by boundary."""
    squared = 0.0
    for k in range(features.shape[1]):
        difference = features[a, k] - features[b, k]
        squared += difference * difference
    na, nb = moments[a].count, moments[b].count
    return na * nb / (na + nb) * squared / math.sqrt(edge_count)


@kernel
def _merge_first(groups, heap, merges, count):
    """Merge and record the first pair of the heap; returns the first link of the group's list."""
    pair = heap.item[0]
    a, b = groups.left[pair], groups.right[pair]
    merges[0, count], merges[1, count] = a, b
    na, nb = groups.moments[a].count, groups.moments[b].count
    fa = na / (na + nb)
    for k in range(groups.features.shape[1]):
        groups.features[a, k] = fa * groups.features[a, k] + (1.0 - fa) * groups.features[b, k]
    unite(groups.moments, a, b, a)
    groups.left[pair] = NONE
    remove(heap, pair)
    return _join_lists(groups, a, b, heap)


@inlined
def _join_lists(groups, a, b, heap):
    """Give group a the pairs of both, pairs with the same group united; returns its first link."""
    left, right = groups.left, groups.right
    following, pair_with = groups.following, groups.pair_with
    kept = NONE
    for group in (a, b):
        link = groups.first[group]
        while link != NONE:
            pair, behind = link >> 1, following[link]
            if left[pair] != NONE:
                other = left[pair] + right[pair] - group
                twin = pair_with[other]
                if twin == NONE:
                    pair_with[other] = pair
                    left[pair], right[pair] = min(a, other), max(a, other)
                    following[link] = kept
                    kept = link
                else:  # both a and b were adjacent to it: one boundary, now
                    groups.edge_count[twin] += groups.edge_count[pair]
                    left[pair] = NONE  # its other link goes when that list is traversed
                    remove(heap, pair)
            link = behind
    groups.first[a], groups.first[b] = kept, NONE
    link = kept
    while link != NONE:
        pair = link >> 1
        pair_with[left[pair] + right[pair] - a] = NONE
        link = following[link]
    return kept
