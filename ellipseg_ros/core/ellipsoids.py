"""Moments of point sets, and the shape that they have."""

import math

import numpy as np

from ellipseg_ros.core.jit import for_rows, kernel
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


def initial_ellipsoids(points: Array, neighbours: Array, chosen: Array, nodes: Array) -> None:
    """Fill the chosen rows of `nodes` with the moments over N(i): i and its neighbours.

    points (n, 3) m, neighbours (n, k) int32, -1 for none, chosen (c,) int. Paper, eqs. 2-5; the
    count is 1.
    """
    for_rows(_initial, len(chosen), points, neighbours, chosen, nodes)


def neighbour_masses(points: Array, neighbours: Array, chosen: Array, masses: Array) -> None:
    """Fill the chosen rows of `masses`: (mean distance to neighbours)^2, m^2 (paper, eq. 6)."""
    for_rows(_masses, len(chosen), points, neighbours, chosen, masses)


def segment_moments(points: Array, labels: Array, before: Array, old: Array) -> Array:
    """Nodes (s, 24) of the points themselves; labels (n,) int32, -1 for none.

    before (s,): row of `old`, the nodes of the last update, if the points are the same, else -1.
    Sums run in the order of the points, about the first: exact to an ulp of the extent.
    """
    nodes, new = np.zeros((len(before), WIDTH)), before < 0
    nodes[~new] = old[before[~new]]
    _sum_points(points, labels, new, nodes)
    for_rows(_shapes, len(before), new, nodes)
    return nodes


def segment_times(times: Array, labels: Array, before: Array, old: Array) -> Array:
    """Times (s, 2) of the oldest and of the newest point of every segment; times (n,) int64, ns.

    before, old: as for the moments.
    """
    limits, new = np.iinfo(np.int64), before < 0
    spans = np.where(new[:, None], [limits.max, limits.min], 0)
    spans[~new] = old[before[~new]]
    _times(times, labels, new, spans)
    return spans


@kernel
def _initial(start, stop, points, neighbours, chosen, nodes):
    k = neighbours.shape[1]
    for which in range(start, stop):
        i = chosen[which]
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        mx = my = mz = 0.0
        members = 1
        for slot in range(k):
            j = neighbours[i, slot]
            if j < 0:
                break
            members += 1
            mx += points[j, 0] - x
            my += points[j, 1] - y
            mz += points[j, 2] - z
        mx, my, mz = mx / members, my / members, mz / members
        xx, xy, xz, yy, yz, zz = mx * mx, mx * my, mx * mz, my * my, my * mz, mz * mz  # i itself
        for slot in range(members - 1):
            j = neighbours[i, slot]
            dx, dy, dz = points[j, 0] - x - mx, points[j, 1] - y - my, points[j, 2] - z - mz
            xx += dx * dx
            xy += dx * dy
            xz += dx * dz
            yy += dy * dy
            yz += dy * dz
            zz += dz * dz
        nodes[i, COUNT] = 1.0
        nodes[i, MEAN], nodes[i, MEAN + 1], nodes[i, MEAN + 2] = x + mx, y + my, z + mz
        nodes[i, COVARIANCE] = xx / members
        nodes[i, COVARIANCE + 1] = xy / members
        nodes[i, COVARIANCE + 2] = xz / members
        nodes[i, COVARIANCE + 3] = yy / members
        nodes[i, COVARIANCE + 4] = yz / members
        nodes[i, COVARIANCE + 5] = zz / members
        shape(nodes, i)


@kernel
def shape(nodes, i):
    """Eigenvalues, axes, planarity and cylindricality from the covariance (paper, eqs. 3-5)."""
    eigen(nodes, i, COVARIANCE, EIGENVALUES, (V1, V2, V3))
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
def _masses(start, stop, points, neighbours, chosen, masses):
    for which in range(start, stop):
        i = chosen[which]
        total = 0.0
        members = 0
        for slot in range(neighbours.shape[1]):
            j = neighbours[i, slot]
            if j < 0:
                break
            members += 1
            dx, dy, dz = (
                points[j, 0] - points[i, 0],
                points[j, 1] - points[i, 1],
                points[j, 2] - points[i, 2],
            )
            total += math.sqrt(dx * dx + dy * dy + dz * dz)
        masses[i] = (total / members) * (total / members) if members > 0 else 0.0


@kernel
def _sum_points(points, labels, new, nodes):
    """Count, mean and covariance of the new segments, about their first points."""
    first = np.zeros((len(nodes), 3))
    for i in range(len(points)):
        s = labels[i]
        if s < 0 or not new[s]:
            continue
        if nodes[s, COUNT] == 0.0:
            for axis in range(3):
                first[s, axis] = points[i, axis]
        nodes[s, COUNT] += 1.0
        for axis in range(3):
            nodes[s, MEAN + axis] += points[i, axis] - first[s, axis]
    for s in np.flatnonzero(new):
        for axis in range(3):
            nodes[s, MEAN + axis] = first[s, axis] + nodes[s, MEAN + axis] / nodes[s, COUNT]
    for i in range(len(points)):
        s = labels[i]
        if s < 0 or not new[s]:
            continue
        dx = points[i, 0] - nodes[s, MEAN]
        dy = points[i, 1] - nodes[s, MEAN + 1]
        dz = points[i, 2] - nodes[s, MEAN + 2]
        nodes[s, COVARIANCE] += dx * dx
        nodes[s, COVARIANCE + 1] += dx * dy
        nodes[s, COVARIANCE + 2] += dx * dz
        nodes[s, COVARIANCE + 3] += dy * dy
        nodes[s, COVARIANCE + 4] += dy * dz
        nodes[s, COVARIANCE + 5] += dz * dz
    for s in np.flatnonzero(new):
        for k in range(COVARIANCE, COVARIANCE + 6):
            nodes[s, k] /= nodes[s, COUNT]


@kernel
def _shapes(start, stop, new, nodes):
    for i in range(start, stop):
        if new[i]:
            shape(nodes, i)


@kernel
def _times(times, labels, new, spans):
    for i in range(len(times)):
        s = labels[i]
        if s >= 0 and new[s]:
            spans[s, 0], spans[s, 1] = min(spans[s, 0], times[i]), max(spans[s, 1], times[i])
