"""Segments -> objects: the second level, by merging the best pair of neighbours first.

A wall or a road is more than one ellipsoid, a tree is many. Two rounds of best-first merging over
the segments that touch: first what is flat together, the thinnest union first; then what is alike,
by features of the shape around every point. All merges are kept, in order: the hierarchy.
"""

import math
from typing import NamedTuple

import numpy as np

from ellipseg_ros.config import ObjectsConfig
from ellipseg_ros.core.adjacency import Boundaries, boundaries
from ellipseg_ros.core.eigen import least_eigenvalue
from ellipseg_ros.core.ellipsoids import (
    COUNT,
    COVARIANCE,
    EIGENVALUES,
    MEAN,
    V1,
    V2,
    V3,
    unite,
)
from ellipseg_ros.core.heap import NOWHERE, empty_heap, remove, set_cost
from ellipseg_ros.core.jit import for_rows, kernel
from ellipseg_ros.core.neighbours import Neighbours
from ellipseg_ros.data import Array, Hierarchy

FEATURES = 4  # linearity, planarity, scattering, twice the verticality
NONE = -1


class Groups(NamedTuple):
    """Groups of segments while they merge; a group is named by its lowest segment.

    Pairs of groups that touch are kept in lists, one a group: link 2 p stands in the list of
    left[p], link 2 p + 1 in that of right[p].
    """

    nodes: Array  # (s, 24) moments of the points
    features: Array  # (s, 4): means over the points
    left: Array  # (p,) int32
    right: Array  # (p,) int32
    length: Array  # (p,) float64: edges of the graph between the two
    first: Array  # (s,) int32: a link, or NONE
    following: Array  # (2 p,) int32: the next link of the same list
    met: Array  # (s,) int32: for finding the pairs that become one; NONE between uses


class Level(NamedTuple):
    """The objects of now; o of them."""

    of_segment: Array  # (s,) int32: the object of every segment
    nodes: Array  # (o, 24) moments of their points
    low: Array  # (o, 3) m, local origin: corners of the box around them
    high: Array  # (o, 3)
    hierarchy: Hierarchy


def find_objects(
    graph: Neighbours, nodes: Array, labels: Array, own: Array, config: ObjectsConfig
) -> Level:
    """Group segments into objects, numbered by their lowest segment.

    nodes (rows and more, 24): initial ellipsoids; labels (rows,) int32: the segment of every
    vertex, -1 for none; own (s, 24): moments of the segments' points.
    """
    touching = boundaries(graph.rows, labels, len(own))
    features = segment_features(nodes, labels, len(own))
    hierarchy = merge_segments(own, features, touching, config.thickness)
    of_segment = hierarchy.after(hierarchy.merges_at(config.scale))
    count = int(of_segment.max(initial=-1)) + 1
    united = np.vstack([np.zeros((count, own.shape[1])), own])
    _unite_all(of_segment, count, united)
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    _boxes(graph.points, labels, of_segment, low, high)
    return Level(of_segment, united[:count], low, high, hierarchy)


def segment_features(nodes: Array, labels: Array, segments: int) -> Array:
    """Features (s, 4) of segments: means over their points, summed in the order of rows.

    nodes (rows and more, 24): initial ellipsoids, labels (rows,) int32, -1 for none. Linearity,
    planarity, scattering and verticality of a point's neighbourhood, from the square roots of the
    eigenvalues: Guinard & Landrieu (2017), Weakly supervised segmentation-aided classification
    of urban scenes from 3D LiDAR point clouds. Verticality counts twice, as they do it.
    """
    features = np.empty((len(labels), FEATURES))
    for_rows(_features, len(labels), nodes, labels, features)
    means = np.zeros((segments, FEATURES))
    _means(features, labels, means)
    return means


def merge_segments(
    nodes: Array, features: Array, touching: Boundaries, thickness: float
) -> Hierarchy:
    """Merge all segments that touch, directly or through others, the best pair first.

    nodes (s, 24): moments of the segments' points; features (s, 4). As long as there are two that
    touch and whose union has a standard deviation of at most `thickness`, m, across, the thinnest
    union is made, at no cost. Then, the pair of the least cost

        n_a n_b / (n_a + n_b) |f_a - f_b|^2 / sqrt(edges between a and b):

    by how much the squared deviations from the mean features grow (Ward 1963), per boundary. Ties:
    the lower segments, a before b.
    """
    groups = _groups(nodes, features, touching)
    merges = np.empty((2, max(0, len(nodes) - 1)), np.int32)
    cost = np.zeros(merges.shape[1])
    heap = empty_heap(len(touching.a))
    flat = _merge_flat(groups, thickness, heap, merges)
    count = _merge_alike(groups, heap, flat, merges, cost)
    return Hierarchy(merges[0, :count], merges[1, :count], cost[:count], len(nodes))


def _groups(nodes: Array, features: Array, touching: Boundaries) -> Groups:
    segments, pairs = len(nodes), len(touching.a)
    groups = Groups(
        nodes=nodes.copy(),
        features=features.copy(),
        left=touching.a.copy(),
        right=touching.b.copy(),
        length=touching.length.astype(np.float64),
        first=np.full(segments, NONE, np.int32),
        following=np.full(2 * pairs, NONE, np.int32),
        met=np.full(segments, NONE, np.int32),
    )
    _link(groups)
    return groups


@kernel
def _features(start, stop, nodes, labels, features):
    for i in range(start, stop):
        if labels[i] < 0:
            continue
        s1, s2, s3 = (
            math.sqrt(nodes[i, EIGENVALUES + 2]),
            math.sqrt(nodes[i, EIGENVALUES + 1]),
            math.sqrt(nodes[i, EIGENVALUES]),
        )
        squared = 0.0
        up = 0.0
        for axis in range(3):
            up = (
                s1 * abs(nodes[i, V1 + axis])
                + s2 * abs(nodes[i, V2 + axis])
                + s3 * abs(nodes[i, V3 + axis])
            )  # of z, at last
            squared += up * up
        if s1 > 0.0:
            features[i, 0], features[i, 1], features[i, 2] = (
                (s1 - s2) / s1,
                (s2 - s3) / s1,
                s3 / s1,
            )
            features[i, 3] = 2.0 * up / math.sqrt(squared)
        else:
            features[i, :] = 0.0


@kernel
def _means(features, labels, means):
    count = np.zeros(len(means), np.int64)
    for i in range(len(labels)):
        s = labels[i]
        if s >= 0:
            count[s] += 1
            for k in range(means.shape[1]):
                means[s, k] += features[i, k]
    for s in range(len(means)):
        for k in range(means.shape[1]):
            means[s, k] /= count[s]


@kernel
def _unite_all(of_segment, count, nodes):
    """Fill the first `count` rows with the moments of objects; those of segments stand behind."""
    for s in range(len(of_segment)):
        into = of_segment[s]
        if nodes[into, COUNT] == 0.0:
            nodes[into, :] = nodes[count + s, :]
        else:
            unite(nodes, into, count + s, into)


@kernel
def _boxes(points, labels, of_segment, low, high):
    for i in range(len(labels)):
        if labels[i] >= 0:
            into = of_segment[labels[i]]
            for axis in range(3):
                low[into, axis] = min(low[into, axis], points[i, axis])
                high[into, axis] = max(high[into, axis], points[i, axis])


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


@kernel
def _offer_flat(groups, pair, limit, heap):
    """Let a pair wait in the heap if its union is flat."""
    a, b = groups.left[pair], groups.right[pair]
    variance = union_thickness(groups.nodes, a, b, limit)
    if variance < math.inf:
        set_cost(heap, pair, variance, (a << 32) + b)
    elif heap.place[pair] != NOWHERE:
        remove(heap, pair)


@kernel
def union_thickness(nodes, a, b, limit):
    """Least variance of the union of two sets, m^2; infinite if it is above the limit."""
    n = nodes[a, COUNT] + nodes[b, COUNT]
    fa, fb = nodes[a, COUNT] / n, nodes[b, COUNT] / n
    if fa * nodes[a, EIGENVALUES] + fb * nodes[b, EIGENVALUES] > limit:
        return math.inf  # a union is no thinner than its parts on average (Weyl)
    dx, dy, dz = (
        nodes[b, MEAN] - nodes[a, MEAN],
        nodes[b, MEAN + 1] - nodes[a, MEAN + 1],
        nodes[b, MEAN + 2] - nodes[a, MEAN + 2],
    )
    between = fa * fb
    xx = fa * nodes[a, COVARIANCE] + fb * nodes[b, COVARIANCE] + between * dx * dx
    xy = fa * nodes[a, COVARIANCE + 1] + fb * nodes[b, COVARIANCE + 1] + between * dx * dy
    xz = fa * nodes[a, COVARIANCE + 2] + fb * nodes[b, COVARIANCE + 2] + between * dx * dz
    yy = fa * nodes[a, COVARIANCE + 3] + fb * nodes[b, COVARIANCE + 3] + between * dy * dy
    yz = fa * nodes[a, COVARIANCE + 4] + fb * nodes[b, COVARIANCE + 4] + between * dy * dz
    zz = fa * nodes[a, COVARIANCE + 5] + fb * nodes[b, COVARIANCE + 5] + between * dz * dz
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
            set_cost(heap, pair, price, (left[pair] << 32) + right[pair])
    while heap.size[0] > 0:
        pair = heap.item[0]
        merges[0, count], merges[1, count] = left[pair], right[pair]
        cost[count] = heap.cost[pair]
        link = _join(groups, pair, heap)
        while link != NONE:
            pair = link >> 1
            price = ward_cost(nodes, features, left[pair], right[pair], length[pair])
            set_cost(heap, pair, price, (left[pair] << 32) + right[pair])
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
