"""Transitional: moments as rows of 24 float64."""

import numpy as np

from ellipseg_ros.core.jit import kernel
from ellipseg_ros.core.linalg.eigen import eigen
from ellipseg_ros.records import Array

# A node is a row of 24 float64 (three cache lines): what the merging needs to know of a segment.
# What an edge and the first term of the shape distance ask for stands first.
COUNT = 0  # points
MEAN = 1  # 3: m, local origin
V3 = 4  # 3: the axis of the least eigenvalue
EIGENVALUES = 7  # 3: ascending, clipped at 0, m^2
PLANARITY = 10
CYLINDRICALITY = 11
V2 = 12  # 3
V1 = 15  # 3
COVARIANCE = 18  # 6: xx, xy, xz, yy, yz, zz, m^2, divided by the count
WIDTH = 24


@kernel
def shape(nodes, i):
    """Eigenvalues, axes, planarity and cylindricality from the covariance (paper, eqs. 3-5)."""
    set_axes(nodes, i)
    e3, e2, e1 = nodes[i, EIGENVALUES], nodes[i, EIGENVALUES + 1], nodes[i, EIGENVALUES + 2]
    total = e1 + e2 + e3
    if total > 0.0:
        nodes[i, PLANARITY] = 2.0 * (e2 - e3) / total
        nodes[i, CYLINDRICALITY] = (e1 - e2) / total
    else:
        nodes[i, PLANARITY] = nodes[i, CYLINDRICALITY] = 0.0
        for k in range(3):
            for v, axis in enumerate((V1, V2, V3)):
                nodes[i, axis + k] = 1.0 if v == k else 0.0


@kernel
def unite(nodes, a, b, into):
    """Moments of two disjoint sets taken together, and their shape.

    Source: Chan, Golub & LeVeque (1979), pairwise update, for covariances instead of sums.
    """
    na, nb = nodes[a, COUNT], nodes[b, COUNT]
    n = na + nb
    fa, fb = na / n, nb / n
    dx, dy, dz = (
        nodes[b, MEAN] - nodes[a, MEAN],
        nodes[b, MEAN + 1] - nodes[a, MEAN + 1],
        nodes[b, MEAN + 2] - nodes[a, MEAN + 2],
    )
    between = fa * fb
    nodes[into, COUNT] = n
    nodes[into, MEAN] = nodes[a, MEAN] + fb * dx
    nodes[into, MEAN + 1] = nodes[a, MEAN + 1] + fb * dy
    nodes[into, MEAN + 2] = nodes[a, MEAN + 2] + fb * dz
    for k in range(COVARIANCE, COVARIANCE + 6):
        nodes[into, k] = fa * nodes[a, k] + fb * nodes[b, k]
    nodes[into, COVARIANCE] += between * dx * dx
    nodes[into, COVARIANCE + 1] += between * dx * dy
    nodes[into, COVARIANCE + 2] += between * dx * dz
    nodes[into, COVARIANCE + 3] += between * dy * dy
    nodes[into, COVARIANCE + 4] += between * dy * dz
    nodes[into, COVARIANCE + 5] += between * dz * dz
    shape(nodes, into)


def united(nodes: Array, group: Array, count: int) -> Array:
    """Nodes (count, 24) of groups of nodes (s, 24); group (s,) int32, the group of each.

    They are united in the order of rows.
    """
    both = np.vstack([np.zeros((count, WIDTH)), nodes])
    _unite_all(group, count, both)
    return both[:count].copy()


@kernel
def _unite_all(group, count, nodes):
    """Fill the first `count` rows with the moments of groups; those of the parts stand behind."""
    for s in range(len(group)):
        into = group[s]
        if nodes[into, COUNT] == 0.0:
            nodes[into, :] = nodes[count + s, :]
        else:
            unite(nodes, into, count + s, into)


@kernel
def set_axes(nodes, i):
    """Eigenvalues and axes from the covariance."""
    e1, e2, e3, axes = eigen(
        nodes[i, COVARIANCE],
        nodes[i, COVARIANCE + 1],
        nodes[i, COVARIANCE + 2],
        nodes[i, COVARIANCE + 3],
        nodes[i, COVARIANCE + 4],
        nodes[i, COVARIANCE + 5],
    )
    nodes[i, EIGENVALUES], nodes[i, EIGENVALUES + 1], nodes[i, EIGENVALUES + 2] = e3, e2, e1
    for k in range(3):
        nodes[i, V1 + k], nodes[i, V2 + k], nodes[i, V3 + k] = axes[k], axes[3 + k], axes[6 + k]
