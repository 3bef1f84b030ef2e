"""Union-find over an array `parent`: parent[i] is i at a root."""

import numpy as np

from ellipseg_ros.core.jit import kernel
from ellipseg_ros.records import Array


@kernel
def find(parent, item):
    """Root of the set of `item`, halving the path to it (Tarjan & van Leeuwen 1984)."""
    while parent[item] != item:
        parent[item] = parent[parent[item]]
        item = parent[item]
    return item


def components(count: int, a: Array, b: Array) -> Array:
    """Connected components of an undirected graph: the lowest vertex of each, (count,) int32.

    a, b: (p,) int, the vertices of every edge.
    """
    parent = np.arange(count, dtype=np.int32)
    _unite(a, b, parent)
    return parent


@kernel
def _unite(a, b, parent):
    for edge in range(len(a)):
        one, other = find(parent, a[edge]), find(parent, b[edge])
        parent[max(one, other)] = min(one, other)
    for vertex in range(len(parent)):
        parent[vertex] = find(parent, vertex)
