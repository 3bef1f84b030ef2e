"""Residual of two landmarks in the motions that their shape determines, with its covariance."""

import math
from typing import NamedTuple

import numpy as np

from ellipseg_ros.association import constants
from ellipseg_ros.core.jit import kernel
from ellipseg_ros.core.linalg.cholesky import factorize, log_determinant, solve_lower
from ellipseg_ros.records import DETERMINED, Array, Kind, Landmarks

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
    arm: Array  # (3,) m: lever arm of a rotation
    transport: Array  # (4, 6): from the own motions of a landmark to the residual
    total: Array  # (4, 4): covariance with that of the transform, then its Cholesky factor
    whitened: Array  # (4,)


def workspace() -> Workspace:
    """Memory for one pair; every thread needs its own."""
    shapes = ((4,), (4, 6), (4, 4), (3, 3), (3,), (4, 6), (4, 4), (4,))
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


@kernel
def transformed(transform, point, k):
    """Component k of a point (3,) under a transform (4, 4)."""
    return (
        transform[k, 0] * point[0]
        + transform[k, 1] * point[1]
        + transform[k, 2] * point[2]
        + transform[k, 3]
    )


@kernel
def rotated(transform, axes, k, axis):
    """Component k of a column of axes (3, 3) under a transform (4, 4)."""
    return (
        transform[k, 0] * axes[0, axis]
        + transform[k, 1] * axes[1, axis]
        + transform[k, 2] * axes[2, axis]
    )


@kernel
def may_match(earlier, later, i, j, transform, tolerance):
    """Whether two landmarks may be the same, if the transform errs by at most the tolerance.

    tolerance: m, rad, and the gap between their boxes in m. Cheap, and never wrongly False:
    compares the directions, the distance across them, and the boxes along the surface or line.
    """
    far, wide, gap = tolerance
    far += earlier.error_bound[i, 0] + later.error_bound[j, 0]
    dx = transformed(transform, later.position[j], 0) - earlier.position[i, 0]
    dy = transformed(transform, later.position[j], 1) - earlier.position[i, 1]
    dz = transformed(transform, later.position[j], 2) - earlier.position[i, 2]
    kind = earlier.kind[i]
    if kind == BLOB:
        return dx * dx + dy * dy + dz * dz <= far * far
    axis = DIRECTION[kind]
    ux, uy, uz = earlier.axes[i, 0, axis], earlier.axes[i, 1, axis], earlier.axes[i, 2, axis]
    across = abs(dx * ux + dy * uy + dz * uz)
    if kind == LINE:
        across = math.sqrt(max(0.0, dx * dx + dy * dy + dz * dz - across * across))
    # Means slide along what is not determined: there the error of the direction counts.
    size = earlier.box_half[i, 0] + earlier.box_half[i, 1]
    size = size + later.box_half[j, 0] + later.box_half[j, 1]
    angle = earlier.error_bound[i, 1] + later.error_bound[j, 1]
    if across > far + angle * size:
        return False
    vx = rotated(transform, later.axes[j], 0, axis)
    vy = rotated(transform, later.axes[j], 1, axis)
    vz = rotated(transform, later.axes[j], 2, axis)
    if abs(ux * vx + uy * vy + uz * vz) < math.cos(min(wide + angle, math.pi / 2.0)):
        return False
    return _boxes_overlap(earlier, later, i, j, transform, gap + tolerance[0] + wide * size)


@kernel
def _boxes_overlap(earlier, later, i, j, transform, gap):
    """Whether the boxes overlap, but for a gap, along the axes that are not determined."""
    axes = earlier.axes[i]
    for a in range(1 if earlier.kind[i] == LINE else 2):
        apart = 0.0
        for k in range(3):
            middle = transformed(transform, later.box_centre[j], k)
            apart += axes[k, a] * (middle - earlier.box_centre[i, k])
        room = gap + earlier.box_half[i, a]
        for b in range(3):
            cosine = 0.0
            for k in range(3):
                cosine += axes[k, a] * rotated(transform, later.axes[j], k, b)
            room += abs(cosine) * later.box_half[j, b]
        if abs(apart) > room:
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
    turn = _frame_between(earlier.axes[i], later.axes[j], kind, transform, work.frame)
    for a in range(degrees):
        motion = MOTIONS[kind, a]
        f = work.frame[:, motion % 3]
        if motion < 3:
            work.residual[a] = 0.0
            for k in range(3):
                p, q = earlier.position[i, k], transformed(transform, later.position[j], k)
                work.residual[a] += f[k] * (q - p)
                work.arm[k] = 0.5 * (p + q) - centre[k]
                work.jacobian[a, k] = f[k]
            _cross(work.arm, f, work.jacobian[a, 3:])
        else:
            work.residual[a] = f[0] * turn[0] + f[1] * turn[1] + f[2] * turn[2]
            for k in range(3):
                work.jacobian[a, k] = 0.0
                work.jacobian[a, 3 + k] = f[k]
    work.covariance[:degrees, :degrees] = 0.0
    _add_covariance(earlier, i, later, j, transform, 1.0, work)
    _add_covariance(earlier, i, later, j, transform, -1.0, work)
    return degrees


@kernel
def _cross(a, b, out):
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@kernel
def _frame_between(one, other, kind, transform, frame):
    """Write the axes half-way between two; returns the rotation (x, y, z) from one to the other.

    Only the direction is rotated. A blob has none: its axes are those of the world.
    """
    if kind == BLOB:
        for k in range(3):
            for a in range(3):
                frame[k, a] = 1.0 if a == k else 0.0
        return 0.0, 0.0, 0.0
    axis = DIRECTION[kind]
    ux, uy, uz = one[0, axis], one[1, axis], one[2, axis]
    vx = rotated(transform, other, 0, axis)
    vy = rotated(transform, other, 1, axis)
    vz = rotated(transform, other, 2, axis)
    if ux * vx + uy * vy + uz * vz < 0.0:  # the sign of a direction is arbitrary
        vx, vy, vz = -vx, -vy, -vz
    wx, wy, wz = 0.5 * (ux + vx), 0.5 * (uy + vy), 0.5 * (uz + vz)
    square = wx * wx + wy * wy + wz * wz
    length = math.sqrt(square)
    second, third = (axis + 1) % 3, (axis + 2) % 3
    bx, by, bz = one[0, second], one[1, second], one[2, second]
    along = (bx * wx + by * wy + bz * wz) / square
    bx, by, bz = bx - along * wx, by - along * wy, bz - along * wz
    unit = 1.0 / math.sqrt(bx * bx + by * by + bz * bz)
    frame[0, axis], frame[1, axis], frame[2, axis] = wx / length, wy / length, wz / length
    frame[0, second], frame[1, second], frame[2, second] = bx * unit, by * unit, bz * unit
    _cross(frame[:, axis], frame[:, second], frame[:, third])
    dx, dy, dz = vx - ux, vy - uy, vz - uz
    return (
        (wy * dz - wz * dy) / square,
        (wz * dx - wx * dz) / square,
        (wx * dy - wy * dx) / square,
    )


@kernel
def _add_covariance(earlier, i, later, j, transform, side, work):
    """Add the covariance of one landmark, transported to the point half-way between the two.

    side: 1 for the earlier one, -1 for the later one.
    """
    kind = earlier.kind[i]
    degrees = DEGREES[kind]
    first = side > 0.0
    covariance = earlier.covariance[i] if first else later.covariance[j]
    for k in range(3):
        apart = transformed(transform, later.position[j], k) - earlier.position[i, k]
        work.arm[k] = 0.5 * side * apart
    for a in range(degrees):
        motion = MOTIONS[kind, a]
        f = work.frame[:, motion % 3]
        if motion < 3:
            _cross(work.arm, f, work.whitened)
        for b in range(3):
            straight, turn = 0.0, 0.0
            for k in range(3):
                axis = earlier.axes[i, k, b] if first else rotated(transform, later.axes[j], k, b)
                straight += f[k] * axis
                turn += work.whitened[k] * axis
            work.transport[a, b] = straight if motion < 3 else 0.0
            work.transport[a, 3 + b] = turn if motion < 3 else straight
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
