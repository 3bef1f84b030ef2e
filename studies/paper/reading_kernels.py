"""The criteria of readings.py: a plain Kruskal that knows all of them."""

import math

import numpy as np

from ellipseg_ros.config import Config
from ellipseg_ros.core.criteria import (
    PARAMETERS,
    bias,
    density_distance,
    segment_aicc,
    shape_distance,
)
from ellipseg_ros.core.disjoint_set import find
from ellipseg_ros.core.ellipsoids import (
    COUNT,
    CYLINDRICALITY,
    EIGENVALUES,
    MEAN,
    PLANARITY,
    V1,
    V2,
    V3,
    unite,
)
from ellipseg_ros.core.jit import kernel

NOISE = Config().model.noise_variance
SHAPE, E3, SHARES, NO_RATIOS, ROOT_N = range(5)
DENSITY, FLOORED, ADDED_MASS, PARSIMONY, AIC, CAPPED = range(5, 11)


@kernel
def walk(nodes, masses, left, right, criterion, floor, threshold, passes):
    """Kruskal's algorithm in place; returns the root of every point. The last row is scratch."""
    above = np.arange(len(nodes))
    scratch = len(nodes) - 1
    for _ in range(passes):
        for edge in range(len(left)):
            a, b = find(above, left[edge]), find(above, right[edge])
            if a == b:
                continue
            if criterion < DENSITY:
                if shape_reading(nodes, a, b, floor, criterion) > threshold:
                    continue
                unite(nodes, a, b, scratch)
            else:
                unite(nodes, a, b, scratch)
                mass = masses[a] + masses[b]
                if union_reading(nodes, a, b, scratch, mass, criterion) > threshold:
                    continue
            nodes[a] = nodes[scratch]
            masses[a] += masses[b]
            above[b] = a
    return np.array([find(above, point) for point in range(scratch)])


@kernel
def shape_reading(nodes, a, b, floor, criterion):
    """Equation 7 and its variants."""
    if criterion == SHAPE:
        return shape_distance(nodes, a, b, floor, math.inf)
    n = nodes[a, COUNT] + nodes[b, COUNT]
    if criterion == ROOT_N:
        return shape_distance(nodes, a, b, floor, math.inf) / math.sqrt(n)
    fa, fb = nodes[a, COUNT] / n, nodes[b, COUNT] / n
    total, ratio3, ratio2, planar, cylindrical = 0.0, 0.0, 0.0, 0.0, 0.0
    for one, f in ((a, fa), (b, fb)):
        e3 = max(nodes[one, EIGENVALUES], floor)
        e2 = max(nodes[one, EIGENVALUES + 1], floor)
        e1 = max(nodes[one, EIGENVALUES + 2], floor)
        p, c = nodes[one, PLANARITY], nodes[one, CYLINDRICALITY]
        s = max(0.0, 1.0 - p - c)
        g3, g2, g1 = (
            gap(nodes, a, b, one, V3),
            gap(nodes, a, b, one, V2),
            gap(nodes, a, b, one, V1),
        )
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
    total += planar * tilt(nodes, a, b, V3) / ratio3
    return total + cylindrical * tilt(nodes, a, b, V1) / ratio2


@kernel
def gap(nodes, a, b, one, axis):
    """Squared gap of the centroids along an axis of one of the two."""
    along = 0.0
    for k in range(3):
        along += nodes[one, axis + k] * (nodes[b, MEAN + k] - nodes[a, MEAN + k])
    return along * along


@kernel
def tilt(nodes, a, b, axis):
    """Squared sine of the angle between two axes."""
    cosine = 0.0
    for k in range(3):
        cosine += nodes[a, axis + k] * nodes[b, axis + k]
    return max(0.0, 1.0 - cosine * cosine)


@kernel
def union_reading(nodes, a, b, union, mass, criterion):
    """Density (eq. 6), parsimony, and their variants."""
    if criterion == DENSITY:
        return density_distance(nodes, union, mass)
    if criterion == ADDED_MASS:
        return density_distance(nodes, union, mass) / nodes[union, COUNT]
    if criterion == FLOORED:
        volume = 4.0 / 3.0 * math.pi
        for k in range(3):
            volume *= math.sqrt(max(nodes[union, EIGENVALUES + k], NOISE))
        return volume * nodes[union, COUNT] / mass if mass > 0.0 else math.inf
    return cost(nodes, union, criterion) - cost(nodes, a, criterion) - cost(nodes, b, criterion)


@kernel
def cost(nodes, i, criterion):
    """AICc of a segment, or with another bias term."""
    whole = segment_aicc(nodes, i, NOISE)
    n = nodes[i, COUNT]
    if criterion == AIC:
        return whole - bias(n) + 2.0 * PARAMETERS
    if criterion == CAPPED:
        return whole - bias(n) + min(bias(n), bias(12.0))
    return whole


@kernel
def total_aicc(nodes, rows):
    """Sum over the segments."""
    total = 0.0
    for row in rows:
        total += segment_aicc(nodes, row, NOISE)
    return total
