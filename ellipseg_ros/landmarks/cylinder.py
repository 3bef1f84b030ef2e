"""Cones and cylinders fitted to points on some side of them, by least squares of distances."""

import math

import numpy as np

from ellipseg_ros.core.jit import kernel
from ellipseg_ros.core.linalg.cholesky import factorize, solve
from ellipseg_ros.core.linalg.vectors import cross, difference, dot, norm, row
from ellipseg_ros.landmarks.fits import add_observation

PARAMETERS = 6  # offset along u, v, m; slope along u, v; radius, m; change of the radius along
RADIUS, TAPER = 4, 5  # places of the last two
RADIUS_PRIOR = 0.1  # m, standard deviation about the first radius: one side alone tells little
TAPER_PRIOR = 0.03  # standard deviation
NOISE = 0.03  # m: standard deviation of a point, against which the priors weigh
MAX_STEPS = 10  # of Gauss-Newton
STEPS_WITH_ALL = 3  # steps before outliers are left out
CUT_SIGMAS = 2.5  # standard deviations from the surface beyond which a point is an outlier
STEP_TOLERANCE = 1e-4  # m: a smaller step is the last
MIN_SURPLUS = 4  # points beyond the number of parameters
RIDGE = 1e-6  # by point: points on one line leave one side undetermined


@kernel
def axial(points, i, point, axis):
    """Coordinate of a point along an axis, and its distance from it, m."""
    offset = difference(row(points, i), point)
    along = dot(offset, axis)
    return along, math.sqrt(max(0.0, dot(offset, offset) - along * along))


@kernel
def across(axis):
    """Unit vectors u and v so that axis, u, v is a right-handed frame."""
    smallest = np.argmin(np.abs(axis))
    u = -axis[smallest] * axis
    u[smallest] += 1.0
    u /= norm(u)
    return u, np.array(cross(axis, u))


@kernel
def residual(points, i, point, u, v, axis, fit, jacobian):
    """Distance of a point from the surface, m, outside positive; minus its derivatives by fit."""
    offset = difference(row(points, i), point)
    along = dot(offset, axis)
    a = dot(offset, u) - fit[0] - fit[2] * along
    b = dot(offset, v) - fit[1] - fit[3] * along
    from_axis = max(1e-9, math.sqrt(a * a + b * b))
    a, b = a / from_axis, b / from_axis
    jacobian[0], jacobian[1] = a, b
    jacobian[2], jacobian[3] = a * along, b * along
    jacobian[4], jacobian[5] = 1.0, along
    return from_axis - fit[4] - fit[5] * along


@kernel
def fit_cylinder(points, rows, point, axis, fit):
    """Fit a cone to points; returns their standard deviation from it, m, or inf if that fails.

    rows: of the points; point, axis: of a first axis; fit (PARAMETERS,): of the cone against that
    axis, filled in; its radius is the expected one on input.
    """
    u, v = across(axis)
    expected = fit[RADIUS]
    fit[:] = 0.0
    fit[RADIUS] = expected
    for i in rows:
        for k in range(3):
            fit[0] += (points[i, k] - point[k]) * u[k] / len(rows)
            fit[1] += (points[i, k] - point[k]) * v[k] / len(rows)
    matrix = np.empty((PARAMETERS, PARAMETERS))
    step, jacobian = np.empty(PARAMETERS), np.empty(PARAMETERS)
    cut, spread = math.inf, math.inf
    for number in range(MAX_STEPS):
        matrix[:] = 0.0
        step[:] = 0.0
        total, kept = 0.0, 0
        for i in rows:
            error = residual(points, i, point, u, v, axis, fit, jacobian)
            if abs(error) <= cut:
                kept += 1
                total += error * error
                add_observation(jacobian, error, matrix, step)
        if kept < PARAMETERS + MIN_SURPLUS:
            return math.inf
        _add_priors(matrix, step, expected, fit, kept)
        spread = math.sqrt(total / (kept - PARAMETERS))
        if not factorize(matrix, PARAMETERS):
            return math.inf
        solve(matrix, PARAMETERS, step)
        fit += step
        if number >= STEPS_WITH_ALL:
            cut = CUT_SIGMAS * spread
        if number > STEPS_WITH_ALL and np.abs(step).max() < STEP_TOLERANCE:
            break
    return spread


@kernel
def _add_priors(matrix, step, expected, fit, kept):
    weight = (NOISE / RADIUS_PRIOR) ** 2
    matrix[RADIUS, RADIUS] += weight
    step[RADIUS] += weight * (expected - fit[RADIUS])
    weight = (NOISE / TAPER_PRIOR) ** 2
    matrix[TAPER, TAPER] += weight
    step[TAPER] -= weight * fit[TAPER]
    for m in range(4):
        matrix[m, m] += RIDGE * kept
