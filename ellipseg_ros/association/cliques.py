"""Sets of candidates of which every two agree."""

import numpy as np

from ellipseg_ros.core.jit import kernel
from ellipseg_ros.records import Array


def cliques(agree: Array, most: int) -> list[Array]:
    """At most so many maximal cliques of a graph (m, m) uint8, by descending size.

    Greedy: a clique grows from the vertex with most neighbours that is in none yet, by the vertex
    that agrees with most of those that still can join; ties by row. To find the largest for sure
    takes exponential time, and here every clique is put to the test of all landmarks anyway.
    """
    members = np.zeros((most, len(agree)), np.int64)
    sizes = np.zeros(most, np.int64)
    count = _grow(agree, members, sizes)
    order = np.argsort(-sizes[:count], kind="stable")
    return [np.sort(members[k, : sizes[k]]) for k in order]


@kernel
def _grow(agree, members, sizes):
    vertices = len(agree)
    degree = np.zeros(vertices, np.int64)
    for a in range(vertices):
        for b in range(vertices):
            degree[a] += agree[a, b]
    taken = np.zeros(vertices, np.bool_)
    left = np.empty(vertices, np.int64)  # those that can still join
    common = np.empty(vertices, np.int64)  # by vertex: how many of those agree with it
    for k in range(len(members)):
        root = -1
        for v in range(vertices):
            if not taken[v] and (root < 0 or degree[v] > degree[root]):
                root = v
        if root < 0:
            return k
        sizes[k] = _grow_from(agree, root, left, common, members[k])
        for v in members[k, : sizes[k]]:
            taken[v] = True
    return len(members)


@kernel
def _grow_from(agree, root, left, common, clique):
    count = 0
    for v in range(len(agree)):
        if agree[root, v]:
            left[count] = v
            count += 1
    for a in range(count):
        common[left[a]] = 0
        for b in range(count):
            common[left[a]] += agree[left[a], left[b]]
    clique[0] = root
    size = 1
    while count > 0:
        best = left[0]
        for v in left[1:count]:
            if common[v] > common[best]:
                best = v
        clique[size] = best
        size += 1
        # Those that do not agree with it leave, and count no more for the others.
        stay = 0
        for a in range(count):
            v = left[a]
            if agree[best, v]:
                left[stay], left[a] = v, left[stay]
                stay += 1
        for v in left[stay:count]:
            for w in left[:stay]:
                common[w] -= agree[v, w]
        count = _in_order(left, stay)
    return size


@kernel
def _in_order(left, count):
    """Sort the first ones, which the swaps have left nearly sorted; returns their number."""
    left[:count].sort()
    return count
