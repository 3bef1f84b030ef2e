"""The criteria of readings.py in a plain Kruskal."""

import math

import numpy as np

from ellipseg_ros.config import Config
from ellipseg_ros.core.criteria import (
    MODEL_PARAMETERS,
    aicc_bias,
    density_distance,
    segment_aicc,
    shape_distance,
    squared_sine,
)
from ellipseg_ros.core.disjoint_set import find
from ellipseg_ros.core.jit import kernel
from ellipseg_ros.core.moments import unite

NOISE = Config().model.noise_variance
SHAPE, E3, SHARES, NO_RATIOS, ROOT_N = range(5)
DENSITY, FLOORED, ADDED_MASS, PARSIMONY, AIC, CAPPED = range(5, 11)


@kernel
def kruskal(moments, masses, left, right, criterion, floor, threshold, passes):
    """Merge in place by Kruskal's algorithm; returns the root of every point.

    The last row of `moments` is scratch.
    """
    parent = np.arange(len(moments))
    scratch = len(moments) - 1
    for _ in range(passes):
        for edge in range(len(left)):
            a, b = find(parent, left[edge]), find(parent, right[edge])
            if a == b:
                continue
            if criterion < DENSITY:
                if shape_reading(moments, a, b, floor, criterion) > threshold:
                    continue
                unite(moments, a, b, scratch)
            else:
                unite(moments, a, b, scratch)
                mass = masses[a] + masses[b]
                if union_reading(moments, a, b, scratch, mass, criterion) > threshold:
                    continue
            moments[a] = moments[scratch]
            masses[a] += masses[b]
            parent[b] = a
    return np.array([find(parent, point) for point in range(scratch)])


@kernel
def shape_reading(moments, row_a, row_b, floor, criterion):
    """Equation 7, or a variant of it."""
    if criterion == SHAPE:
        return shape_distance(moments, row_a, row_b, floor, math.inf)
    n = moments[row_a].count + moments[row_b].count
    if criterion == ROOT_N:
        return shape_distance(moments, row_a, row_b, floor, math.inf) / math.sqrt(n)
    fa, fb = moments[row_a].count / n, moments[row_b].count / n
    total, ratio3, ratio2, planar, cylindrical = 0.0, 0.0, 0.0, 0.0, 0.0
    for row, f in ((row_a, fa), (row_b, fb)):
        m = moments[row]
        e1, e2, e3 = max(m.e1, floor), max(m.e2, floor), max(m.e3, floor)
        p, c = m.planarity, m.cylindricality
        s = max(0.0, 1.0 - p - c)
        g1 = squared_gap(moments, row_a, row_b, m.v1_x, m.v1_y, m.v1_z)
        g2 = squared_gap(moments, row_a, row_b, m.v2_x, m.v2_y, m.v2_z)
        g3 = squared_gap(moments, row_a, row_b, m.v3_x, m.v3_y, m.v3_z)
        if criterion == SHARES:
            total += f * (p * g3 / e3 + c * (g2 / e2 + g3 / e3) + s * (g1 + g2 + g3) / e1)
        else:
            total += f * (g3 / e3 + (1.0 - p) * g2 / e2 + s * g1 / (e3 if criterion == E3 else e1))
        planar += f * p
        cylindrical += f * c
        ratio3 += e3 / e2
        ratio2 += e2 / e1
    if criterion == NO_RATIOS:
        ratio3 = ratio2 = 1.0
    a, b = moments[row_a], moments[row_b]
    tilt3 = squared_sine(a.v3_x, a.v3_y, a.v3_z, b.v3_x, b.v3_y, b.v3_z)
    tilt1 = squared_sine(a.v1_x, a.v1_y, a.v1_z, b.v1_x, b.v1_y, b.v1_z)
    return total + planar * tilt3 / ratio3 + cylindrical * tilt1 / ratio2


@kernel
def squared_gap(moments, a, b, x, y, z):
    """Squared gap of the centroids along an axis (x, y, z)."""
    along = x * (moments[b].mean_x - moments[a].mean_x)
    along += y * (moments[b].mean_y - moments[a].mean_y)
    along += z * (moments[b].mean_z - moments[a].mean_z)
    return along * along


@kernel
def union_reading(moments, a, b, union, mass, criterion):
    """Density (eq. 6), parsimony, or a variant of one."""
    if criterion == DENSITY:
        return density_distance(moments, union, mass)
    if criterion == ADDED_MASS:
        return density_distance(moments, union, mass) / moments[union].count
    if criterion == FLOORED:
        m = moments[union]
        product = max(m.e1, NOISE) * max(m.e2, NOISE) * max(m.e3, NOISE)
        volume = 4.0 / 3.0 * math.pi * math.sqrt(product)
        return volume * m.count / mass if mass > 0.0 else math.inf
    return (
        cost(moments, union, criterion) - cost(moments, a, criterion) - cost(moments, b, criterion)
    )


@kernel
def cost(moments, i, criterion):
    """AICc of a segment, perhaps with another bias term."""
    whole = segment_aicc(moments, i, NOISE)
    n = moments[i].count
    if criterion == AIC:
        return whole - aicc_bias(n) + 2.0 * MODEL_PARAMETERS
    if criterion == CAPPED:
        return whole - aicc_bias(n) + min(aicc_bias(n), aicc_bias(12.0))
    return whole


@kernel
def total_aicc(moments, rows):
    """AICc of all segments."""
    total = 0.0
    for row in rows:
        total += segment_aicc(moments, row, NOISE)
    return total
