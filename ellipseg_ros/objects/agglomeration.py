"""Best-first merging of segments that touch: first what is flat together, then what is alike.

All merges are kept, in order: the hierarchy of objects.
"""

import math
from typing import NamedTuple

import numpy as np

from ellipseg_ros.core.flat_moments import COUNT, COVARIANCE, EIGENVALUES, MEAN, unite
from ellipseg_ros.core.jit import inlined, kernel
from ellipseg_ros.core.linalg.eigen import least_eigenvalue
from ellipseg_ros.objects.indexed_heap import NOWHERE, empty_heap, remove, set_cost
from ellipseg_ros.records import Array, Hierarchy, SegmentAdjacency

NONE = -1


class Groups(NamedTuple):
    """Groups of segments while they merge; a group is named by its lowest segment.

    Pairs of groups that touch stand in lists, one a group: pair p has two links, 2 p and 2 p + 1,
    one in the list of either group.
    """

    nodes: Array  # (s, 24) moments of the points
    features: Array  # (s, 4): means over the points
    left: Array  # (p,) int32
    right: Array  # (p,) int32
    length: Array  # (p,) float64: edges of the graph between the two
    first: Array  # (s,) int32: a link, or NONE
    following: Array  # (2 p,) int32: the next link of the same list
    met: Array  # (s,) int32: for finding the pairs that become one; NONE between uses


def merge_segments(
    nodes: Array, features: Array, adjacency: SegmentAdjacency, thickness: float
) -> Hierarchy:
    """Merge all segments that touch, directly or through others, the best pair first.

    nodes (s, 24): moments of the segments' points; features (s, 4). As long as there are two that
    touch and whose union has a standard deviation of at most `thickness`, m, across, both weighed
    equally, the thinnest union is made, at no cost. Then, the pair of the least cost

        n_a n_b / (n_a + n_b) |f_a - f_b|^2 / sqrt(edges between a and b):

    by how much the squared deviations from the mean features grow (Ward 1963), per boundary. Ties:
    the lower segments, a before b.
    """
    groups = _groups(nodes, features, adjacency)
    merges = np.empty((2, max(0, len(nodes) - 1)), np.int32)
    cost = np.zeros(merges.shape[1])
    heap = empty_heap(len(adjacency.a))
    flat = _merge_flat(groups, thickness, heap, merges)
    count = _merge_alike(groups, heap, flat, merges, cost)
    return Hierarchy(merges[0, :count], merges[1, :count], cost[:count], len(nodes))


def flat_groups(nodes: Array, adjacency: SegmentAdjacency, thickness: float) -> Array:
    """The group (s,) int32 of every segment when only what is flat together has been merged.

    nodes (s, 24), thickness: as for `merge_segments`, of which this is the first part.
    """
    groups = _groups(nodes, np.zeros((len(nodes), 0)), adjacency)
    merges = np.empty((2, max(0, len(nodes) - 1)), np.int32)
    count = _merge_flat(groups, thickness, empty_heap(len(adjacency.a)), merges)
    return Hierarchy(
        merges[0, :count], merges[1, :count], np.zeros(count), len(nodes)
    ).labels_after(count)


def _groups(nodes: Array, features: Array, adjacency: SegmentAdjacency) -> Groups:
    segments, pairs = len(nodes), len(adjacency.a)
    groups = Groups(
        nodes=nodes.copy(),
        features=features.copy(),
        left=adjacency.a.copy(),
        right=adjacency.b.copy(),
        length=adjacency.edge_count.astype(np.float64),
        first=np.full(segments, NONE, np.int32),
        following=np.full(2 * pairs, NONE, np.int32),
        met=np.full(segments, NONE, np.int32),
    )
    _link(groups)
    return groups


@kernel
def _link(groups):
    for pair in range(len(groups.left)):
        for side in range(2):
            group = groups.left[pair] if side == 0 else groups.right[pair]
            groups.following[2 * pair + side] = groups.first[group]
            groups.first[group] = 2 * pair + side


@kernel
def _merge_flat(groups, thickness, heap, merges):
    """Merge pairs with a flat union, the thinnest first; returns how many merges there were."""
    limit = thickness * thickness
    for pair in range(len(groups.left)):
        _offer_flat(groups, pair, limit, heap)
    count = 0
    while heap.size[0] > 0:
        pair = heap.item[0]
        merges[0, count], merges[1, count] = groups.left[pair], groups.right[pair]
        link = _join(groups, pair, heap)
        while link != NONE:
            _offer_flat(groups, link >> 1, limit, heap)
            link = groups.following[link]
        count += 1
    return count


@inlined
def _offer_flat(groups, pair, limit, heap):
    """Let a pair wait in the heap if its union is flat."""
    a, b = groups.left[pair], groups.right[pair]
    variance = union_thickness(groups.nodes, a, b, limit)
    if variance < math.inf:
        set_cost(heap, pair, variance, (np.int64(a) << 32) + b)
    elif heap.place[pair] != NOWHERE:
        remove(heap, pair)


@kernel
def union_thickness(nodes, a, b, limit):
    """Least variance of the union of two sets, m^2; infinite if it is above the limit.

    Both weigh the same, however many points they have: beside a wall, a post would weigh nothing.
    """
    if nodes[a, EIGENVALUES] + nodes[b, EIGENVALUES] > 2.0 * limit:
        return math.inf  # a union is no thinner than its parts on average (Weyl)
    dx, dy, dz = (
        nodes[b, MEAN] - nodes[a, MEAN],
        nodes[b, MEAN + 1] - nodes[a, MEAN + 1],
        nodes[b, MEAN + 2] - nodes[a, MEAN + 2],
    )
    xx = 0.5 * (nodes[a, COVARIANCE] + nodes[b, COVARIANCE]) + 0.25 * dx * dx
    xy = 0.5 * (nodes[a, COVARIANCE + 1] + nodes[b, COVARIANCE + 1]) + 0.25 * dx * dy
    xz = 0.5 * (nodes[a, COVARIANCE + 2] + nodes[b, COVARIANCE + 2]) + 0.25 * dx * dz
    yy = 0.5 * (nodes[a, COVARIANCE + 3] + nodes[b, COVARIANCE + 3]) + 0.25 * dy * dy
    yz = 0.5 * (nodes[a, COVARIANCE + 4] + nodes[b, COVARIANCE + 4]) + 0.25 * dy * dz
    zz = 0.5 * (nodes[a, COVARIANCE + 5] + nodes[b, COVARIANCE + 5]) + 0.25 * dz * dz
    # Above the limit if the matrix less the limit is positive definite (Sylvester): quicker.
    px, py, pz = xx - limit, yy - limit, zz - limit
    minor = px * py - xy * xy
    if (
        px > 0.0
        and minor > 0.0
        and pz * minor - px * yz * yz - py * xz * xz + 2 * xy * xz * yz > 0
    ):
        return math.inf
    least = least_eigenvalue(xx, xy, xz, yy, yz, zz)
    return least if least <= limit else math.inf


@kernel
def _merge_alike(groups, heap, count, merges, cost):
    """Merge whatever touches, the cheapest first; goes on after `count` merges."""
    left, right, length, following = groups.left, groups.right, groups.length, groups.following
    nodes, features = groups.nodes, groups.features
    for pair in range(len(left)):
        if left[pair] != NONE:
            price = ward_cost(nodes, features, left[pair], right[pair], length[pair])
            set_cost(heap, pair, price, (np.int64(left[pair]) << 32) + right[pair])
    while heap.size[0] > 0:
        pair = heap.item[0]
        merges[0, count], merges[1, count] = left[pair], right[pair]
        cost[count] = heap.cost[0]
        link = _join(groups, pair, heap)
        while link != NONE:
            pair = link >> 1
            price = ward_cost(nodes, features, left[pair], right[pair], length[pair])
            set_cost(heap, pair, price, (np.int64(left[pair]) << 32) + right[pair])
            link = following[link]
        count += 1
    return count


@kernel
def ward_cost(nodes, features, a, b, length):
    """By how much the squared deviations from the mean features grow, per boundary."""
    squared = 0.0
    for k in range(features.shape[1]):
        difference = features[a, k] - features[b, k]
        squared += difference * difference
    na, nb = nodes[a, COUNT], nodes[b, COUNT]
    return na * nb / (na + nb) * squared / math.sqrt(length)


@kernel
def _join(groups, pair, heap):
    """Make one group of the two of a pair; returns the first link of its list."""
    left, right, following, met = groups.left, groups.right, groups.following, groups.met
    nodes, features, length = groups.nodes, groups.features, groups.length
    a, b = left[pair], right[pair]
    fa = nodes[a, COUNT] / (nodes[a, COUNT] + nodes[b, COUNT])
    for k in range(features.shape[1]):
        features[a, k] = fa * features[a, k] + (1.0 - fa) * features[b, k]
    unite(nodes, a, b, a)
    left[pair] = NONE
    remove(heap, pair)
    kept = NONE
    for group in (a, b):
        link = groups.first[group]
        while link != NONE:
            pair, behind = link >> 1, following[link]
            if left[pair] != NONE:
                other = left[pair] + right[pair] - group
                twin = met[other]
                if twin == NONE:
                    met[other] = pair
                    left[pair], right[pair] = min(a, other), max(a, other)
                    following[link] = kept
                    kept = link
                else:  # both a and b touched it: one boundary, now
                    length[twin] += length[pair]
                    left[pair] = NONE  # its other link goes when that list is gone through
                    if heap.place[pair] != NOWHERE:
                        remove(heap, pair)
            link = behind
    groups.first[a], groups.first[b] = kept, NONE
    link = kept
    while link != NONE:
        pair = link >> 1
        met[left[pair] + right[pair] - a] = NONE
        link = following[link]
    return kept
