"""Maximal cliques of the consistency graph: sets of candidates that are pairwise consistent."""

import numpy as np

from ellipseg_ros.core.jit import kernel
from ellipseg_ros.records import Array


def maximal_cliques(consistent: Array, max_cliques: int) -> list[Array]:
    """Some maximal cliques of a graph (m, m) uint8, each ascending, by descending size.

    Greedy: a clique grows from the vertex of highest degree that is in none yet, by the vertex
    that is adjacent to most of those that can still join; ties by row. Finding the largest clique
    for certain takes exponential time, and every clique is tested on all landmarks anyway.
    """
    degree = consistent.sum(axis=1, dtype=np.int64)
    members = np.empty(len(consistent), np.int64)
    cliques: list[Array] = []
    while len(cliques) < max_cliques and (degree >= 0).any():
        size = _grow(consistent, int(degree.argmax()), members)
        cliques.append(np.sort(members[:size]))
        degree[cliques[-1]] = -1
    return sorted(cliques, key=len, reverse=True)


@kernel
def _grow(consistent, root, members):
    """Write a maximal clique that contains the root; returns its size."""
    joinable = np.flatnonzero(consistent[root])
    common = np.zeros(len(consistent), np.int64)  # by vertex: joinable vertices adjacent to it
    for v in joinable:
        for w in joinable:
            common[v] += consistent[v, w]
    members[0] = root
    size = 1
    while len(joinable) > 0:
        best = joinable[np.argmax(common[joinable])]
        members[size] = best
        size += 1
        stays = consistent[best][joinable] > 0
        leaving, joinable = joinable[~stays], joinable[stays]
        for v in leaving:
            for w in joinable:
                common[w] -= consistent[v, w]
    return size
