"""Round bodies fitted to points on some side of them, by least squares of radial distances."""

import math

import numpy as np

from ellipseg_ros.core.jit import kernel
from ellipseg_ros.landmarks.fits import cholesky, solve

PARAMETERS = 6  # offset along u and v, m; slope along u and v; radius, m; change of it along
RADIUS_PRIOR = 0.1  # m, standard deviation about where it starts: little is seen of some sides
TAPER_PRIOR = 0.03
NOISE = 0.03  # m, of a point, against which the priors weigh
STEPS = 10  # of Gauss and Newton's method
CUT = 2.5  # standard deviations from which on a point does not count,
SMALL = 1e-4  # m: a step that ends the search
ALL = 3  # after so many steps with all points


@kernel
def place(points, i, point, axis):
    """Where a point is, along an axis and aside from it."""
    x, y, z = points[i, 0] - point[0], points[i, 1] - point[1], points[i, 2] - point[2]
    along = x * axis[0] + y * axis[1] + z * axis[2]
    return along, math.sqrt(max(0.0, x * x + y * y + z * z - along * along))


@kernel
def across(axis):
    """Unit vectors u and v so that axis, u, v is a right-handed frame."""
    least = 0
    for k in range(1, 3):
        if abs(axis[k]) < abs(axis[least]):
            least = k
    u = -axis[least] * axis
    u[least] += 1.0
    u /= math.sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
    v = np.array(
        [
            axis[1] * u[2] - axis[2] * u[1],
            axis[2] * u[0] - axis[0] * u[2],
            axis[0] * u[1] - axis[1] * u[0],
        ]
    )
    return u, v


@kernel
def residual(points, i, point, u, v, axis, fit, jacobian):
    """Distance of a point from the surface, m, outside positive; minus its derivatives by fit."""
    x, y, z = points[i, 0] - point[0], points[i, 1] - point[1], points[i, 2] - point[2]
    along = x * axis[0] + y * axis[1] + z * axis[2]
    a = x * u[0] + y * u[1] + z * u[2] - fit[0] - fit[2] * along
    b = x * v[0] + y * v[1] + z * v[2] - fit[1] - fit[3] * along
    from_axis = max(1e-9, math.sqrt(a * a + b * b))
    a, b = a / from_axis, b / from_axis
    jacobian[0], jacobian[1] = a, b
    jacobian[2], jacobian[3] = a * along, b * along
    jacobian[4], jacobian[5] = 1.0, along
    return from_axis - fit[4] - fit[5] * along


@kernel
def fit_cylinder(points, rows, point, axis, fit):
    """Fit a round body to points; returns their standard deviation from it, m, or inf.

    rows: of the points; point, axis: a first axis; fit (PARAMETERS,): of the true one against it,
    filled in; fit[4] is what the radius is expected to be.
    """
    u, v = across(axis)
    expected = fit[4]
    fit[:] = 0.0
    fit[4] = expected
    for i in rows:
        for k in range(3):
            fit[0] += (points[i, k] - point[k]) * u[k] / len(rows)
            fit[1] += (points[i, k] - point[k]) * v[k] / len(rows)
    matrix = np.empty((PARAMETERS, PARAMETERS))
    step, jacobian = np.empty(PARAMETERS), np.empty(PARAMETERS)
    cut, spread = math.inf, math.inf
    for number in range(STEPS):
        matrix[:] = 0.0
        step[:] = 0.0
        total, kept = 0.0, 0
        for i in rows:
            error = residual(points, i, point, u, v, axis, fit, jacobian)
            if abs(error) > cut:
                continue
            kept += 1
            total += error * error
            for m in range(PARAMETERS):
                step[m] += jacobian[m] * error
                for n in range(m + 1):
                    matrix[m, n] += jacobian[m] * jacobian[n]
        if kept < PARAMETERS + 4:
            return math.inf
        _add_priors(matrix, step, expected, fit, kept)
        spread = math.sqrt(total / (kept - PARAMETERS))
        if not cholesky(matrix):
            return math.inf
        solve(matrix, step)
        fit += step
        if number >= ALL:
            cut = CUT * spread
        if number > ALL and np.abs(step).max() < SMALL:
            break
    return spread


@kernel
def _add_priors(matrix, step, expected, fit, kept):
    weight = (NOISE / RADIUS_PRIOR) ** 2
    matrix[4, 4] += weight
    step[4] += weight * (expected - fit[4])
    weight = (NOISE / TAPER_PRIOR) ** 2
    matrix[5, 5] += weight
    step[5] -= weight * fit[5]
    for m in range(4):
        matrix[m, m] += 1e-6 * kept  # points on one line leave one side open
