"""When two segments are one: the merge criteria, and the information criterion behind them."""

import math

from ellipseg_ros.core.ellipsoids import (
    COUNT,
    CYLINDRICALITY,
    EIGENVALUES,
    MEAN,
    PLANARITY,
    V1,
    V2,
    V3,
)
from ellipseg_ros.core.jit import kernel

PARAMETERS = 9  # K: mean 3, covariance 6
LOG_2PI = math.log(2.0 * math.pi)


@kernel
def shape_distance(nodes, a, b, floor, limit):
    """Distance of two segments in terms of their own shape (paper, eq. 7); no unit.

    floor, m^2: least eigenvalue. Stops early, above `limit`, where the rest cannot bring it below:
    all terms are at least 0. e1 stands in the spherical term [choice: DESIGN 2.7].
    """
    na, nb = nodes[a, COUNT], nodes[b, COUNT]
    fa = na / (na + nb)
    fb = 1.0 - fa
    dx = nodes[b, MEAN] - nodes[a, MEAN]
    dy = nodes[b, MEAN + 1] - nodes[a, MEAN + 1]
    dz = nodes[b, MEAN + 2] - nodes[a, MEAN + 2]
    a3 = max(nodes[a, EIGENVALUES], floor)
    b3 = max(nodes[b, EIGENVALUES], floor)
    along_a = nodes[a, V3] * dx + nodes[a, V3 + 1] * dy + nodes[a, V3 + 2] * dz
    along_b = nodes[b, V3] * dx + nodes[b, V3 + 1] * dy + nodes[b, V3 + 2] * dz
    total = fa * along_a * along_a / a3 + fb * along_b * along_b / b3
    if total > limit:
        return total
    a2 = max(nodes[a, EIGENVALUES + 1], floor)
    b2 = max(nodes[b, EIGENVALUES + 1], floor)
    pa, pb = nodes[a, PLANARITY], nodes[b, PLANARITY]
    total += (fa * pa + fb * pb) * _tilt(nodes, a, b, V3) / (a3 / a2 + b3 / b2)
    if total > limit:
        return total
    a1 = max(nodes[a, EIGENVALUES + 2], floor)
    b1 = max(nodes[b, EIGENVALUES + 2], floor)
    ca, cb = nodes[a, CYLINDRICALITY], nodes[b, CYLINDRICALITY]
    along_a = nodes[a, V2] * dx + nodes[a, V2 + 1] * dy + nodes[a, V2 + 2] * dz
    along_b = nodes[b, V2] * dx + nodes[b, V2 + 1] * dy + nodes[b, V2 + 2] * dz
    total += (
        fa * (1.0 - pa) * along_a * along_a / a2
        + fb * (1.0 - pb) * along_b * along_b / b2
        + (fa * ca + fb * cb) * _tilt(nodes, a, b, V1) / (a2 / a1 + b2 / b1)
    )
    along_a = nodes[a, V1] * dx + nodes[a, V1 + 1] * dy + nodes[a, V1 + 2] * dz
    along_b = nodes[b, V1] * dx + nodes[b, V1 + 1] * dy + nodes[b, V1 + 2] * dz
    sa, sb = max(0.0, 1.0 - pa - ca), max(0.0, 1.0 - pb - cb)
    return total + fa * sa * along_a * along_a / a1 + fb * sb * along_b * along_b / b1


@kernel
def _tilt(nodes, a, b, axis):
    """Squared sine of the angle between two axes."""
    cosine = (
        nodes[a, axis] * nodes[b, axis]
        + nodes[a, axis + 1] * nodes[b, axis + 1]
        + nodes[a, axis + 2] * nodes[b, axis + 2]
    )
    return max(0.0, 1.0 - cosine * cosine)


@kernel
def density_distance(nodes, union, mass):
    """Volume of the united ellipsoid per mean mass, m: the inverse of the paper's density (eq. 6).

    mass, m^2: the sum over the points. Their mean decides [choice: docs/explanation/method.md].
    """
    volume = (
        4.0
        / 3.0
        * math.pi
        * math.sqrt(
            nodes[union, EIGENVALUES + 2]
            * nodes[union, EIGENVALUES + 1]
            * nodes[union, EIGENVALUES]
        )
    )
    if volume == 0.0:
        return 0.0
    return volume * nodes[union, COUNT] / mass if mass > 0.0 else math.inf


@kernel
def segment_aicc(nodes, i, noise):
    """Corrected Akaike information criterion of one segment (paper, eqs. 9-14).

    noise, m^2: least variance. The eigenvalues are modulated by the shape (eq. 13).
    """
    n = nodes[i, COUNT]
    planarity, cylindricality = nodes[i, PLANARITY], nodes[i, CYLINDRICALITY]
    sphericity = max(0.0, 1.0 - planarity - cylindricality)
    product = (
        max(nodes[i, EIGENVALUES + 2] * sphericity, noise)
        * max(nodes[i, EIGENVALUES + 1] * (1.0 - planarity), noise)
        * max(nodes[i, EIGENVALUES], noise)
    )
    variance = n * (3.0 * LOG_2PI + math.log(product) + 3.0)
    return variance + bias(n)


@kernel
def bias(n):
    """Bias term of the AICc of a segment of n points: what its parameters cost (paper, eq. 14)."""
    return 2.0 * PARAMETERS * n / max(1.0, n - PARAMETERS - 1.0)
