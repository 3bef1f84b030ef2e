"""Region growing: Kruskal's walk over the sorted edges, merging while the criterion allows."""

from typing import NamedTuple

import numpy as np

from ellipseg_ros.config import CRITERIA, Config
from ellipseg_ros.core.criteria import density_distance, segment_aicc, shape_distance
from ellipseg_ros.core.disjoint_set import find
from ellipseg_ros.core.edges import Edges
from ellipseg_ros.core.ellipsoids import unite
from ellipseg_ros.core.jit import kernel
from ellipseg_ros.data import Array

SHAPE, DENSITY, PARSIMONY = range(
    len(CRITERIA)
)  # numbers for the kernels, in the order of CRITERIA


class Merged(NamedTuple):
    """The forest that the walk has grown; its roots are the segments."""

    roots: Array  # (s,) int32: rows of the nodes, by the lowest vertex below
    labels: Array  # (n,) int32: row of `roots` of every vertex, -1 where isolated
    aicc: Array  # (s,) float64


def merge(nodes: Array, edges: Edges, isolated: Array, masses: Array, config: Config) -> Merged:
    """Walk the edges; two segments a (i's) and b become one where D(a, b) <= tau.

    nodes (2 n, 24): initial ellipsoids in the first n rows; a union takes the next free row.
    masses (2 n,) m^2, likewise; only density reads it.
    """
    n = len(isolated)
    criterion = CRITERIA.index(config.criterion)
    floor, noise = config.model.eigenvalue_floor, config.model.noise_variance
    above = np.arange(2 * n, dtype=np.int32)
    extra = masses
    if criterion == PARSIMONY:
        extra = np.empty(2 * n)
        _aicc_of(nodes, np.arange(n), noise, extra)
    _walk(nodes, above, extra, edges, criterion, config.tau, floor, noise)
    labels = np.full(n, -1, np.int32)
    roots = np.empty(n, np.int32)
    roots = roots[: _label(above, isolated, labels, roots)]
    aicc = np.empty(len(roots))
    _aicc_of(nodes, roots, noise, aicc)
    return Merged(roots, labels, aicc)


@kernel
def _walk(nodes, above, extra, edges, criterion, tau, floor, noise):
    """Returns the number of nodes in use. extra: a node's mass (density) or AICc (parsimony)."""
    left, right = edges[1], edges[2]
    free = len(above) // 2
    for e in range(len(left)):
        a, b = find(above, left[e]), find(above, right[e])
        if a == b:
            continue
        if criterion == SHAPE:
            if shape_distance(nodes, a, b, floor, tau) > tau:
                continue
            unite(nodes, a, b, free)
        elif criterion == DENSITY:
            unite(nodes, a, b, free)
            if density_distance(nodes, free, extra[a] + extra[b]) > tau:
                continue
            extra[free] = extra[a] + extra[b]
        else:
            unite(nodes, a, b, free)
            extra[free] = segment_aicc(nodes, free, noise)
            if extra[free] - extra[a] - extra[b] > tau:
                continue
        above[a] = above[b] = free
        free += 1
    return free


@kernel
def _label(above, isolated, labels, roots):
    """Number the segments by their lowest vertex; returns how many there are."""
    row = np.full(len(above), -1, np.int32)
    count = 0
    for v in range(len(isolated)):
        if isolated[v]:
            continue
        root = find(above, v)
        if row[root] < 0:
            row[root] = count
            roots[count] = root
            count += 1
        labels[v] = row[root]
    return count


@kernel
def _aicc_of(nodes, rows, noise, aicc):
    for k in range(len(rows)):
        aicc[k] = segment_aicc(nodes, rows[k], noise)
