"""Two landmarks beside one another: how far apart they are in what their shape determines."""

import math
from typing import NamedTuple

import numpy as np

from ellipseg_ros.core.jit import kernel
from ellipseg_ros.core.linalg.cholesky import factorize, log_determinant, solve_lower
from ellipseg_ros.records import DETERMINED, Array, Kind, Landmarks

PLANE, LINE, BLOB = int(Kind.PLANE), int(Kind.LINE), int(Kind.BLOB)
MOST = max(map(len, DETERMINED.values()))  # determined motions of any kind
ROWS = np.array([DETERMINED[kind] + (-1,) * (MOST - len(DETERMINED[kind])) for kind in Kind])
DEGREES = np.array([len(DETERMINED[kind]) for kind in Kind])
MAIN = np.array([2, 0, -1])  # by kind: the axis that is its direction; a blob has none
CERTAIN = 4.0  # standard deviations within which a quantity lies for sure


class Things(NamedTuple):
    """Landmarks as the kernels take them; row i is landmark i."""

    kind: Array  # (l,) int64
    position: Array  # (l, 3) m
    axes: Array  # (l, 3, 3)
    covariance: Array  # (l, 6, 6) m, rad: along the determined motions, in the own axes
    middle: Array  # (l, 3) m: of the box, world frame
    half: Array  # (l, 3) m: half its lengths, along the own axes
    thickness: Array  # (l,) m: across a line, mean of a blob; 1 for a plane
    blur: Array  # (l, 2) m, rad: beyond these, two landmarks differ for sure


class Scratch(NamedTuple):
    """What `compare` finds out about a pair; d is the number of determined motions."""

    r: Array  # (4,) m, rad: how far the later one lies from the earlier one; d are in use
    jacobian: Array  # (4, 6): its change with a small motion of the later one
    noise: Array  # (4, 4): its covariance, of both landmarks
    frame: Array  # (3, 3): columns are the axes half-way between the two
    lever: Array  # (3,)
    part: Array  # (4, 6)
    total: Array  # (4, 4)
    white: Array  # (4,)


def scratch() -> Scratch:
    """Room for one pair; one for each thread."""
    shapes = ((4,), (4, 6), (4, 4), (3, 3), (3,), (4, 6), (4, 4), (4,))
    return Scratch(*(np.zeros(shape) for shape in shapes))


def things(landmarks: Landmarks, order: Array, noise: float, angle_noise: float) -> Things:
    """Rows of the landmarks in a given order; noise in m and rad, added to their covariance."""
    rows = (landmarks.kind, landmarks.position, landmarks.axes, landmarks.covariance)
    kind, position, axes, covariance = (column[order] for column in rows)
    low, high, sigma = landmarks.box_min[order], landmarks.box_max[order], landmarks.sigma[order]
    floor = np.repeat([noise * noise, angle_noise * angle_noise], 3) / 2.0  # half from each
    determined = np.array([[k in DETERMINED[Kind(row)] for k in range(6)] for row in range(3)])
    covariance = covariance + (determined[kind] * floor)[:, :, None] * np.eye(6)
    spread = CERTAIN * np.sqrt(np.maximum(0.0, np.einsum("nii->ni", covariance)))
    half = (high - low) / 2.0
    angle = np.hypot(np.hypot(spread[:, 3], spread[:, 4]), spread[:, 5])
    radius = np.sqrt((half**2).sum(axis=1))
    along = np.sqrt((spread[:, :3] ** 2).sum(axis=1)) + angle * radius
    across = np.array([np.ones(len(kind)), np.hypot(sigma[:, 1], sigma[:, 2]), sigma.mean(axis=1)])
    return Things(
        kind.astype(np.int64),
        np.ascontiguousarray(position, np.float64),
        np.ascontiguousarray(axes, np.float64),
        covariance,
        position + np.einsum("nij,nj->ni", axes, (low + high) / 2.0),
        half,
        across[kind, np.arange(len(kind))],
        np.column_stack([along, angle]),
    )


@kernel
def moved(transform, point, k):
    """Component k of a point (3,) under a transform (4, 4)."""
    return (
        transform[k, 0] * point[0]
        + transform[k, 1] * point[1]
        + transform[k, 2] * point[2]
        + transform[k, 3]
    )


@kernel
def turned(transform, axes, k, axis):
    """Component k of a column of axes (3, 3) under a transform."""
    return (
        transform[k, 0] * axes[0, axis]
        + transform[k, 1] * axes[1, axis]
        + transform[k, 2] * axes[2, axis]
    )


@kernel
def near(earlier, later, i, j, transform, reach):
    """Whether the two may be one, when the transform may be wrong by reach = (m, rad, gap in m).

    Cheap, and never wrongly False: what differs is the angle between the directions, the distance
    across them, or the gap between the boxes along them.
    """
    far, wide, gap = reach
    far += earlier.blur[i, 0] + later.blur[j, 0]
    dx = moved(transform, later.position[j], 0) - earlier.position[i, 0]
    dy = moved(transform, later.position[j], 1) - earlier.position[i, 1]
    dz = moved(transform, later.position[j], 2) - earlier.position[i, 2]
    kind = earlier.kind[i]
    if kind == BLOB:
        return dx * dx + dy * dy + dz * dz <= far * far
    axis = MAIN[kind]
    ux, uy, uz = earlier.axes[i, 0, axis], earlier.axes[i, 1, axis], earlier.axes[i, 2, axis]
    across = abs(dx * ux + dy * uy + dz * uz)
    if kind == LINE:
        across = math.sqrt(max(0.0, dx * dx + dy * dy + dz * dz - across * across))
    # Means slide along what is not determined: there the doubt about the direction counts.
    size = earlier.half[i, 0] + earlier.half[i, 1] + later.half[j, 0] + later.half[j, 1]
    blur = earlier.blur[i, 1] + later.blur[j, 1]
    if across > far + blur * size:
        return False
    vx = turned(transform, later.axes[j], 0, axis)
    vy = turned(transform, later.axes[j], 1, axis)
    vz = turned(transform, later.axes[j], 2, axis)
    if abs(ux * vx + uy * vy + uz * vz) < math.cos(min(wide + blur, math.pi / 2.0)):
        return False
    return _boxes_meet(earlier, later, i, j, transform, gap + reach[0] + wide * size)


@kernel
def _boxes_meet(earlier, later, i, j, transform, gap):
    """Whether the boxes overlap, but for a gap, along the axes that are not determined."""
    axes = earlier.axes[i]
    count = 1 if earlier.kind[i] == LINE else 2
    for a in range(count):
        apart = 0.0
        for k in range(3):
            apart += axes[k, a] * (moved(transform, later.middle[j], k) - earlier.middle[i, k])
        room = gap + earlier.half[i, a]
        for b in range(3):
            cosine = 0.0
            for k in range(3):
                cosine += axes[k, a] * turned(transform, later.axes[j], k, b)
            room += abs(cosine) * later.half[j, b]
        if abs(apart) > room:
            return False
    return True


@kernel
def compare(earlier, later, i, j, transform, centre, found):
    """Fill `found` for landmark j, moved by the transform, beside i; return how many rows.

    All is taken half-way between the two, where the equations of a turn are linear without error
    (Gibbs vector g: p' - p = g x (p' + p)). centre (3,): about which small motions turn.
    """
    kind = earlier.kind[i]
    rows = DEGREES[kind]
    ox, oy, oz = _middle_frame(earlier.axes[i], later.axes[j], kind, transform, found.frame)
    for a in range(rows):
        row = ROWS[kind, a]
        f = found.frame[:, row % 3]
        if row < 3:
            found.r[a] = 0.0
            for k in range(3):
                p, q = earlier.position[i, k], moved(transform, later.position[j], k)
                found.r[a] += f[k] * (q - p)
                found.lever[k] = 0.5 * (p + q) - centre[k]
                found.jacobian[a, k] = f[k]
            _cross(found.lever, f, found.jacobian[a, 3:])
        else:
            found.r[a] = f[0] * ox + f[1] * oy + f[2] * oz
            for k in range(3):
                found.jacobian[a, k] = 0.0
                found.jacobian[a, 3 + k] = f[k]
    found.noise[:rows, :rows] = 0.0
    _add_noise(earlier, i, later, j, transform, 1.0, found)
    _add_noise(earlier, i, later, j, transform, -1.0, found)
    return rows


@kernel
def _cross(a, b, out):
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@kernel
def _middle_frame(one, other, kind, transform, frame):
    """The axes of one, turned half-way to the other's direction; returns the turn to it, x, y, z.

    A blob has no direction: its axes are those of the world.
    """
    if kind == BLOB:
        for k in range(3):
            for a in range(3):
                frame[k, a] = 1.0 if a == k else 0.0
        return 0.0, 0.0, 0.0
    axis = MAIN[kind]
    ux, uy, uz = one[0, axis], one[1, axis], one[2, axis]
    vx = turned(transform, other, 0, axis)
    vy = turned(transform, other, 1, axis)
    vz = turned(transform, other, 2, axis)
    if ux * vx + uy * vy + uz * vz < 0.0:  # the sign of a direction means nothing
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
def _add_noise(earlier, i, later, j, transform, side, found):
    """Add the covariance of one of the two, carried from its position to the point half-way.

    side: 1 for the earlier one, -1 for the later one.
    """
    kind = earlier.kind[i]
    rows = DEGREES[kind]
    first = side > 0.0
    covariance = earlier.covariance[i] if first else later.covariance[j]
    for k in range(3):
        apart = moved(transform, later.position[j], k) - earlier.position[i, k]
        found.lever[k] = 0.5 * side * apart
    for a in range(rows):
        row = ROWS[kind, a]
        f = found.frame[:, row % 3]
        if row < 3:
            _cross(found.lever, f, found.white)
        for b in range(3):
            straight, turn = 0.0, 0.0
            for k in range(3):
                axis = earlier.axes[i, k, b] if first else turned(transform, later.axes[j], k, b)
                straight += f[k] * axis
                turn += found.white[k] * axis
            found.part[a, b] = straight if row < 3 else 0.0
            found.part[a, 3 + b] = turn if row < 3 else straight
    for a in range(rows):
        for b in range(a + 1):
            total = 0.0
            for m in range(6):
                for n in range(6):
                    total += found.part[a, m] * covariance[m, n] * found.part[b, n]
            found.noise[a, b] += total
            if b != a:
                found.noise[b, a] += total


@kernel
def spread(found, rows, uncertainty):
    """Whiten r by its noise and that of the transform (6, 6): (square, log determinant)."""
    for a in range(rows):
        found.white[a] = found.r[a]
        for b in range(a + 1):
            total = found.noise[a, b]
            for m in range(6):
                for n in range(6):
                    total += found.jacobian[a, m] * uncertainty[m, n] * found.jacobian[b, n]
            found.total[a, b] = total
    factorize(found.total, rows)
    solve_lower(found.total, rows, found.white)
    square = 0.0
    for a in range(rows):
        square += found.white[a] * found.white[a]
    return square, log_determinant(found.total, rows)
