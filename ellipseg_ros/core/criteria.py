"""The merge criteria: everything about them stands here.

A criterion is a row of CRITERIA, its distance, and a branch in `merge_distance` (and in
`initial_values`, if it sums something over the points). The order of the rows is that of the
numbers SHAPE, DENSITY, PARSIMONY, which the kernels know.
"""

import math
from typing import NamedTuple

from ellipseg_ros.config import Config
from ellipseg_ros.core.jit import for_rows, inlined, kernel
from ellipseg_ros.core.linalg.vectors import difference, norm, row
from ellipseg_ros.core.moments import unite
from ellipseg_ros.records import Array


class Criterion(NamedTuple):
    """What users need to know of a merge criterion; segments merge while D(a, b) <= threshold."""

    about: str
    unit: str  # of the threshold; empty: none
    default_threshold: float
    search_range: tuple[float, float]  # that tuning tries: from hardly any merge to nearly all


CRITERIA = {
    "shape": Criterion("distance by the shapes of both (paper, eq. 7)", "", 4.8, (0.1, 100.0)),
    "density": Criterion("volume of the union per mass (paper, eq. 6)", "m", 0.6, (1e-3, 1e3)),
    "parsimony": Criterion("growth of the AICc by the merge", "", 5.0, (0.1, 100.0)),
}
SHAPE, DENSITY, PARSIMONY = range(len(CRITERIA))

MODEL_PARAMETERS = 9  # K of the AICc: mean 3, covariance 6
LOG_2PI = math.log(2.0 * math.pi)


class Rule(NamedTuple):
    """The criterion in force and its constants, for the kernels."""

    criterion: int  # SHAPE, DENSITY or PARSIMONY
    threshold: float
    eigenvalue_floor: float  # m^2
    noise_variance: float  # m^2


def rule_of(config: Config) -> Rule:
    """The criterion of `config` with its constants."""
    model = config.model
    number = list(CRITERIA).index(config.criterion)
    return Rule(number, config.tau, model.eigenvalue_floor, model.noise_variance)


def initial_values(
    rule: Rule, points: Array, knn_indices: Array, moments: Array, rows: Array, values: Array
) -> None:
    """Set values[rows] to what the criterion carries along for single points.

    density: the mass of the point, (mean distance to its neighbours)^2, m^2 (paper, eq. 6);
    parsimony: the AICc of its initial ellipsoid; shape: nothing.
    """
    if rule.criterion == DENSITY:
        for_rows(_masses, len(rows), points, knn_indices, rows, values)
    elif rule.criterion == PARSIMONY:
        segments_aicc(moments, rows, rule.noise_variance, values)


@inlined
def merge_distance(moments, values, a, b, union, rule):
    """Distance D(a, b) of two segments by the criterion in force.

    If they may merge, moments[union] and values[union] are set to those of the union.
    """
    criterion, threshold, floor, noise = rule
    if criterion == SHAPE:
        distance = shape_distance(moments, a, b, floor, threshold)
        if not distance > threshold:
            unite(moments, a, b, union)
    elif criterion == DENSITY:
        unite(moments, a, b, union)
        values[union] = values[a] + values[b]
        distance = density_distance(moments, union, values[union])
    else:
        unite(moments, a, b, union)
        values[union] = segment_aicc(moments, union, noise)
        distance = values[union] - values[a] - values[b]
    return distance


@kernel
def shape_distance(moments, row_a, row_b, floor, limit):
    """Distance of two segments in terms of their own shapes (paper, eq. 7); no unit.

    floor: least eigenvalue, m^2. The result is exact up to `limit`, above it a lower bound: all
    terms are at least 0. e1 stands in the spherical term [choice: DESIGN 2.7].
    """
    a, b = moments[row_a], moments[row_b]
    fa = a.count / (a.count + b.count)
    fb = 1.0 - fa
    dx, dy, dz = b.mean_x - a.mean_x, b.mean_y - a.mean_y, b.mean_z - a.mean_z
    a3, b3 = max(a.e3, floor), max(b.e3, floor)
    along_a = a.v3_x * dx + a.v3_y * dy + a.v3_z * dz
    along_b = b.v3_x * dx + b.v3_y * dy + b.v3_z * dz
    distance = fa * along_a * along_a / a3 + fb * along_b * along_b / b3
    if distance > limit:
        return distance
    a2, b2 = max(a.e2, floor), max(b.e2, floor)
    tilt = squared_sine(a.v3_x, a.v3_y, a.v3_z, b.v3_x, b.v3_y, b.v3_z)
    distance += (fa * a.planarity + fb * b.planarity) * tilt / (a3 / a2 + b3 / b2)
    if distance > limit:
        return distance
    a1, b1 = max(a.e1, floor), max(b.e1, floor)
    along_a = a.v2_x * dx + a.v2_y * dy + a.v2_z * dz
    along_b = b.v2_x * dx + b.v2_y * dy + b.v2_z * dz
    tilt = squared_sine(a.v1_x, a.v1_y, a.v1_z, b.v1_x, b.v1_y, b.v1_z)
    distance += (
        fa * (1.0 - a.planarity) * along_a * along_a / a2
        + fb * (1.0 - b.planarity) * along_b * along_b / b2
        + (fa * a.cylindricality + fb * b.cylindricality) * tilt / (a2 / a1 + b2 / b1)
    )
    along_a = a.v1_x * dx + a.v1_y * dy + a.v1_z * dz
    along_b = b.v1_x * dx + b.v1_y * dy + b.v1_z * dz
    sphericity_a = max(0.0, 1.0 - a.planarity - a.cylindricality)
    sphericity_b = max(0.0, 1.0 - b.planarity - b.cylindricality)
    return (
        distance
        + fa * sphericity_a * along_a * along_a / a1
        + fb * sphericity_b * along_b * along_b / b1
    )


@kernel
def squared_sine(ax, ay, az, bx, by, bz):
    """Squared sine of the angle between two unit vectors."""
    cosine = ax * bx + ay * by + az * bz
    return max(0.0, 1.0 - cosine * cosine)


@kernel
def density_distance(moments, union, mass):
    """Volume of the united ellipsoid per mean mass, m: the inverse of the paper's density (eq. 6).

    mass: the sum over the points, m^2. Their mean decides [choice: docs/explanation/method.md].
    """
    m = moments[union]
    volume = 4.0 / 3.0 * math.pi * math.sqrt(m.e1 * m.e2 * m.e3)
    if volume == 0.0:
        return 0.0
    return volume * m.count / mass if mass > 0.0 else math.inf


@kernel
def segment_aicc(moments, row, noise):
    """Corrected Akaike information criterion of one segment (paper, eqs. 9-14).

    noise: least variance, m^2. The eigenvalues are modulated by the shape (eq. 13).
    """
    m = moments[row]
    sphericity = max(0.0, 1.0 - m.planarity - m.cylindricality)
    product = (
        max(m.e1 * sphericity, noise) * max(m.e2 * (1.0 - m.planarity), noise) * max(m.e3, noise)
    )
    return m.count * (3.0 * LOG_2PI + math.log(product) + 3.0) + aicc_bias(m.count)


@kernel
def aicc_bias(n):
    """Bias term of the AICc of a segment of n points: what its parameters cost (paper, eq. 14)."""
    return 2.0 * MODEL_PARAMETERS * n / max(1.0, n - MODEL_PARAMETERS - 1.0)


@kernel
def segments_aicc(moments, rows, noise, aicc):
    """Set aicc[row] to that of the segment, for all `rows` (r,)."""
    for k in range(len(rows)):
        aicc[rows[k]] = segment_aicc(moments, rows[k], noise)


@kernel
def _masses(start, stop, points, knn_indices, rows, masses):
    for r in range(start, stop):
        i = rows[r]
        total, neighbours = 0.0, 0
        for slot in range(knn_indices.shape[1]):
            j = knn_indices[i, slot]
            if j < 0:
                break
            neighbours += 1
            total += norm(difference(row(points, j), row(points, i)))
        mean = total / max(1, neighbours)
        masses[i] = mean * mean
