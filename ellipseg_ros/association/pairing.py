"""Residual of two landmarks in the motions that their shape determines, with its covariance."""

import math
from typing import NamedTuple

import numpy as np

from ellipseg_ros.association import constants
from ellipseg_ros.core.jit import inlined, kernel
from ellipseg_ros.core.linalg.cholesky import factorize, log_determinant, solve_lower
from ellipseg_ros.core.linalg.vectors import (
    column,
    combined,
    cross,
    difference,
    dot,
    norm,
    row,
    scaled,
)
from ellipseg_ros.records import DETERMINED, Array, Kind, Landmarks

IDENTITY = np.eye(4)
PLANE, LINE, BLOB = int(Kind.PLANE), int(Kind.LINE), int(Kind.BLOB)
DEGREES = np.array([len(DETERMINED[kind]) for kind in Kind])  # by kind: determined motions
MAX_DEGREES = int(DEGREES.max())
MOTIONS = np.array([DETERMINED[k] + (-1,) * (MAX_DEGREES - len(DETERMINED[k])) for k in Kind])
DIRECTION = np.array([2, 0, -1])  # by kind: the axis that is its direction; a blob has none


class LandmarkArrays(NamedTuple):
    """Landmarks as the kernels take them; row i is landmark i."""

    kind: Array  # (l,) int64
    position: Array  # (l, 3) m
    axes: Array  # (l, 3, 3)
    covariance: Array  # (l, 6, 6) m, rad: of the determined motions, in the own axes
    box_centre: Array  # (l, 3) m, world frame
    box_half: Array  # (l, 3) m: half the edges of the box, along the own axes
    size: Array  # (l,) m: thickness of a line, mean sigma of a blob; 1 for a plane
    error_bound: Array  # (l, 2) m, rad: of the position, and of the direction


class Workspace(NamedTuple):
    """Residual of one pair and intermediate results; of a kind with d determined motions."""

    residual: Array  # (4,) m, rad: of the later landmark against the earlier one; d are in use
    jacobian: Array  # (4, 6): derivative by a small motion of the later landmark
    covariance: Array  # (4, 4): of the residual, from both landmarks
    frame: Array  # (3, 3): columns are the axes half-way between the two
    transport: Array  # (4, 6): from the own motions of a landmark to the residual
    total: Array  # (4, 4): covariance with that of the transform, then its Cholesky factor
    whitened: Array  # (4,)


def workspace() -> Workspace:
    """Memory for one pair; every thread needs its own."""
    shapes = ((4,), (4, 6), (4, 4), (3, 3), (4, 6), (4, 4), (4,))
    return Workspace(*(np.zeros(shape) for shape in shapes))


def landmark_arrays(
    landmarks: Landmarks, rows: Array, noise: float, angle_noise: float
) -> LandmarkArrays:
    """Rows of the landmarks; noise, in m and rad, of a pair is added to their covariance."""
    columns = (landmarks.kind, landmarks.position, landmarks.axes, landmarks.covariance)
    kind, position, axes, covariance = (column[rows] for column in columns)
    low, high, sigma = landmarks.box_min[rows], landmarks.box_max[rows], landmarks.sigma[rows]
    floor = np.repeat([noise * noise, angle_noise * angle_noise], 3) / 2.0  # half from each
    determined = np.array([[k in DETERMINED[Kind(row)] for k in range(6)] for row in range(3)])
    covariance = covariance + (determined[kind] * floor)[:, :, None] * np.eye(6)
    bound = constants.BOUND_SIGMAS * np.sqrt(np.maximum(0.0, np.einsum("nii->ni", covariance)))
    half = (high - low) / 2.0
    angle = np.hypot(np.hypot(bound[:, 3], bound[:, 4]), bound[:, 5])
    radius = np.sqrt((half**2).sum(axis=1))
    length = np.sqrt((bound[:, :3] ** 2).sum(axis=1)) + angle * radius
    sizes = np.array([np.ones(len(kind)), np.hypot(sigma[:, 1], sigma[:, 2]), sigma.mean(axis=1)])
    return LandmarkArrays(
        kind=kind.astype(np.int64),
        position=np.ascontiguousarray(position, np.float64),
        axes=np.ascontiguousarray(axes, np.float64),
        covariance=covariance,
        box_centre=position + np.einsum("nij,nj->ni", axes, (low + high) / 2.0),
        box_half=half,
        size=sizes[kind, np.arange(len(kind))],
        error_bound=np.column_stack([length, angle]),
    )


@inlined
def rotated(transform, direction):
    """A direction (x, y, z) under a transform (4, 4)."""
    x, y, z = direction
    return (
        transform[0, 0] * x + transform[0, 1] * y + transform[0, 2] * z,
        transform[1, 0] * x + transform[1, 1] * y + transform[1, 2] * z,
        transform[2, 0] * x + transform[2, 1] * y + transform[2, 2] * z,
    )


@inlined
def transformed(transform, point):
    """A point (x, y, z) under a transform (4, 4)."""
    x, y, z = rotated(transform, point)
    return x + transform[0, 3], y + transform[1, 3], z + transform[2, 3]


@kernel
def may_match(earlier, later, i, j, transform, tolerance):
    """Whether two landmarks may be the same, if the transform errs by at most the tolerance.

    tolerance: m, rad, and the gap between their boxes in m. Cheap, and never wrongly False:
    compares the directions, the distance across them, and the boxes along the surface or line.
    """
    far, wide, gap = tolerance
    far += earlier.error_bound[i, 0] + later.error_bound[j, 0]
    offset = difference(transformed(transform, row(later.position, j)), row(earlier.position, i))
    kind = earlier.kind[i]
    if kind == BLOB:
        return dot(offset, offset) <= far * far
    axis = DIRECTION[kind]
    direction = column(earlier.axes[i], axis)
    across = abs(dot(offset, direction))
    if kind == LINE:
        across = math.sqrt(max(0.0, dot(offset, offset) - across * across))
    # Means slide along what is not determined: there the error of the direction counts.
    size = earlier.box_half[i, 0] + earlier.box_half[i, 1]
    size = size + later.box_half[j, 0] + later.box_half[j, 1]
    angle = earlier.error_bound[i, 1] + later.error_bound[j, 1]
    if across > far + angle * size:
        return False
    cosine = abs(dot(direction, rotated(transform, column(later.axes[j], axis))))
    if cosine < math.cos(min(wide + angle, math.pi / 2.0)):
        return False
    return _boxes_overlap(earlier, later, i, j, transform, gap + tolerance[0] + wide * size)


@kernel
def _boxes_overlap(earlier, later, i, j, transform, gap):
    """Whether the boxes overlap, but for a gap, along the axes that are not determined."""
    offset = difference(
        transformed(transform, row(later.box_centre, j)), row(earlier.box_centre, i)
    )
    axes, other = earlier.axes[i], later.axes[j]
    for a in range(1 if earlier.kind[i] == LINE else 2):
        axis = column(axes, a)
        room = gap + earlier.box_half[i, a]
        for b in range(3):
            cosine = dot(axis, rotated(transform, column(other, b)))
            room += abs(cosine) * later.box_half[j, b]
        if abs(dot(axis, offset)) > room:
            return False
    return True


@kernel
def compare(earlier, later, i, j, transform, centre, work):
    """Compute residual, Jacobian and covariance of landmark j, transformed, against landmark i.

    All are taken half-way between the two, where the equations of a rotation are linear without
    error (Gibbs vector g: p' - p = g x (p' + p)). centre (3,): about which small motions rotate.
    Returns the number of determined motions.
    """
    kind = earlier.kind[i]
    degrees = DEGREES[kind]
    p, q = row(earlier.position, i), transformed(transform, row(later.position, j))
    turn = _frame_between(earlier.axes[i], later.axes[j], kind, transform, work.frame)
    for a in range(degrees):
        motion = MOTIONS[kind, a]
        f = column(work.frame, motion % 3)
        if motion < 3:
            work.residual[a] = dot(f, difference(q, p))
            middle = scaled(0.5, combined(p, 1.0, q))
            lever = cross(difference(middle, centre), f)
            for k in range(3):
                work.jacobian[a, k], work.jacobian[a, 3 + k] = f[k], lever[k]
        else:
            work.residual[a] = dot(f, turn)
            for k in range(3):
                work.jacobian[a, k], work.jacobian[a, 3 + k] = 0.0, f[k]
    work.covariance[:degrees, :degrees] = 0.0
    arm = scaled(0.5, difference(q, p))
    _add_covariance(earlier, i, IDENTITY, arm, work)
    _add_covariance(later, j, transform, scaled(-1.0, arm), work)
    return degrees


@kernel
def _frame_between(one, other, kind, transform, frame):
    """Write the axes half-way between two; returns the rotation (x, y, z) from one to the other.

    Only the direction is rotated. A blob has none: its axes are those of the world.
    """
    if kind == BLOB:
        frame[:] = np.eye(3)
        return 0.0, 0.0, 0.0
    axis = DIRECTION[kind]
    second, third = (axis + 1) % 3, (axis + 2) % 3
    u, v = column(one, axis), rotated(transform, column(other, axis))
    sign = -1.0 if dot(u, v) < 0.0 else 1.0  # the sign of a direction is arbitrary
    v = scaled(sign, v)
    w = scaled(0.5, combined(u, 1.0, v))
    square, b = dot(w, w), column(one, second)
    b = combined(b, -(dot(b, w) / square), w)
    length, unit = math.sqrt(square), 1.0 / norm(b)
    for k in range(3):
        frame[k, axis], frame[k, second] = w[k] / length, b[k] * unit
    frame[0, third], frame[1, third], frame[2, third] = cross(
        column(frame, axis), column(frame, second)
    )
    turn = cross(w, difference(v, u))
    return turn[0] / square, turn[1] / square, turn[2] / square


@kernel
def _add_covariance(landmarks, row, transform, arm, work):
    """Add the covariance of one landmark, transported by `arm` to the point half-way between two.

    transform: of its own set.
    """
    kind = landmarks.kind[row]
    degrees, covariance = DEGREES[kind], landmarks.covariance[row]
    for b in range(3):
        axis = rotated(transform, column(landmarks.axes[row], b))
        for a in range(degrees):
            motion = MOTIONS[kind, a]
            f = column(work.frame, motion % 3)
            straight = dot(f, axis)
            work.transport[a, b] = straight if motion < 3 else 0.0
            work.transport[a, 3 + b] = dot(cross(arm, f), axis) if motion < 3 else straight
    for a in range(degrees):
        for b in range(a + 1):
            total = 0.0
            for m in range(6):
                for n in range(6):
                    total += work.transport[a, m] * covariance[m, n] * work.transport[b, n]
            work.covariance[a, b] += total
            if b != a:
                work.covariance[b, a] += total


@kernel
def mahalanobis(work, degrees, uncertainty):
    """Squared Mahalanobis distance of a pair, and the log determinant of its covariance.

    uncertainty (6, 6): covariance of the transform, which adds to that of the residual.
    """
    for a in range(degrees):
        work.whitened[a] = work.residual[a]
        for b in range(a + 1):
            total = work.covariance[a, b]
            for m in range(6):
                for n in range(6):
                    total += work.jacobian[a, m] * uncertainty[m, n] * work.jacobian[b, n]
            work.total[a, b] = total
    factorize(work.total, degrees)
    solve_lower(work.total, degrees, work.whitened)
    square = 0.0
    for a in range(degrees):
        square += work.whitened[a] * work.whitened[a]
    return square, log_determinant(work.total, degrees)
