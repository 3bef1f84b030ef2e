"""Eigenvalues and axes of symmetric 3x3 matrices, in closed form."""

import math

from ellipseg_ros.core.jit import kernel

THIRD = 2.0 * math.pi / 3.0
TINY = 1e-290  # a matrix below is taken for zero: its inverse would overflow


@kernel
def eigen(xx, xy, xz, yy, yz, zz):
    """Decompose a symmetric matrix: e1 >= e2 >= e3, clipped at 0, and the axes v1, v2, v3.

    The axes are nine numbers in a row; the largest component of v1 and of v2 is positive,
    v3 = v1 x v2. They are those of the identity where all eigenvalues are 0.

    The axis of the most separate eigenvalue comes from cross products, the other two from one
    rotation within its complement (Eberly, "A Robust Eigensolver for 3x3 Symmetric Matrices",
    2014), eigenvalues from Rayleigh quotients: accurate to a few ulp of the largest.
    """
    scale = max(abs(xx), abs(yy), abs(zz), max(abs(xy), abs(xz), abs(yz)))
    if not scale > TINY:
        return 0.0, 0.0, 0.0, (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    unit = 1.0 / scale
    xx, xy, xz, yy, yz, zz = xx * unit, xy * unit, xz * unit, yy * unit, yz * unit, zz * unit
    wx, wy, wz = _separate_axis(xx, xy, xz, yy, yz, zz)
    ew = _form(xx, xy, xz, yy, yz, zz, wx, wy, wz)
    eu, ux, uy, uz, ev, vx, vy, vz = _complement(xx, xy, xz, yy, yz, zz, wx, wy, wz)
    if ew >= eu:
        e1, ax, ay, az, e2, bx, by, bz, e3 = ew, wx, wy, wz, eu, ux, uy, uz, ev
    elif ew >= ev:
        e1, ax, ay, az, e2, bx, by, bz, e3 = eu, ux, uy, uz, ew, wx, wy, wz, ev
    else:
        e1, ax, ay, az, e2, bx, by, bz, e3 = eu, ux, uy, uz, ev, vx, vy, vz, ew
    sign = _sign(ax, ay, az)
    ax, ay, az = sign * ax, sign * ay, sign * az
    sign = _sign(bx, by, bz)
    bx, by, bz = sign * bx, sign * by, sign * bz
    cx, cy, cz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    e1, e2, e3 = max(0.0, e1 * scale), max(0.0, e2 * scale), max(0.0, e3 * scale)
    return e1, e2, e3, (ax, ay, az, bx, by, bz, cx, cy, cz)


@kernel
def least_eigenvalue(xx, xy, xz, yy, yz, zz):
    """The least eigenvalue of a symmetric matrix, at least 0, without the axes: four times faster.

    Smith's root (1961), then a step of Newton's on the characteristic polynomial. In error by at
    most 1e-9 of the largest eigenvalue, at twofold ones; else by some ulp of it.
    """
    middle = (xx + yy + zz) / 3.0
    bx, by, bz = xx - middle, yy - middle, zz - middle
    off = xy * xy + xz * xz + yz * yz
    spread = math.sqrt((bx * bx + by * by + bz * bz + 2.0 * off) / 6.0)
    if not spread > 0.0:
        return max(0.0, middle)
    det = bx * (by * bz - yz * yz) - xy * (xy * bz - yz * xz) + xz * (xy * yz - by * xz)
    half = min(1.0, max(-1.0, det / (2.0 * spread * spread * spread)))
    root = 2.0 * spread * math.cos(math.acos(half) / 3.0 + THIRD)
    # x^3 - 3 spread^2 x - det = 0 for x = root
    slope = 3.0 * (root * root - spread * spread)
    if slope > 1e-6 * spread * spread:
        root -= (root * (root * root - 3.0 * spread * spread) - det) / slope
    return max(0.0, middle + root)


@kernel
def _separate_axis(xx, xy, xz, yy, yz, zz):
    """Unit axis of the eigenvalue farther from the middle one, by its trigonometric root.

    Source: Smith, Eigenvalues of a symmetric 3x3 matrix (1961).
    """
    middle = (xx + yy + zz) / 3.0
    bx, by, bz = xx - middle, yy - middle, zz - middle
    off = xy * xy + xz * xz + yz * yz
    spread = math.sqrt((bx * bx + by * by + bz * bz + 2.0 * off) / 6.0)
    if not spread > 0.0:
        return 1.0, 0.0, 0.0
    det = bx * (by * bz - yz * yz) - xy * (xy * bz - yz * xz) + xz * (xy * yz - by * xz)
    half = min(1.0, max(-1.0, det / (2.0 * spread * spread * spread)))
    angle = math.acos(half) / 3.0 + (THIRD if half < 0.0 else 0.0)
    root = 2.0 * spread * math.cos(angle)
    ax, ay, az = bx - root, by - root, bz - root
    # Cross products of the rows of A - root I: the longest is the best conditioned.
    px, py, pz = xy * yz - xz * ay, xz * xy - ax * yz, ax * ay - xy * xy
    qx, qy, qz = xy * az - xz * yz, xz * xz - ax * az, ax * yz - xy * xz
    rx, ry, rz = ay * az - yz * yz, yz * xz - xy * az, xy * yz - ay * xz
    p2, q2, r2 = (
        px * px + py * py + pz * pz,
        qx * qx + qy * qy + qz * qz,
        rx * rx + ry * ry + rz * rz,
    )
    if q2 > p2 and q2 >= r2:
        px, py, pz, p2 = qx, qy, qz, q2
    elif r2 > p2:
        px, py, pz, p2 = rx, ry, rz, r2
    if not p2 > 0.0:
        return 1.0, 0.0, 0.0
    unit = 1.0 / math.sqrt(p2)
    return px * unit, py * unit, pz * unit


@kernel
def _form(xx, xy, xz, yy, yz, zz, wx, wy, wz):  # noqa: PLR0913  # a matrix and an axis
    """The quadratic form w A w."""
    return (
        wx * (xx * wx + xy * wy + xz * wz)
        + wy * (xy * wx + yy * wy + yz * wz)
        + wz * (xz * wx + yz * wy + zz * wz)
    )


@kernel
def _complement(xx, xy, xz, yy, yz, zz, wx, wy, wz):  # noqa: PLR0913  # likewise
    """The other two eigenvalues, descending, each before its axis: e, x, y, z, e, x, y, z."""
    if abs(wx) > abs(wy):
        unit = 1.0 / math.sqrt(wx * wx + wz * wz)
        ux, uy, uz = -wz * unit, 0.0, wx * unit
    else:
        unit = 1.0 / math.sqrt(wy * wy + wz * wz)
        ux, uy, uz = 0.0, wz * unit, -wy * unit
    vx, vy, vz = wy * uz - wz * uy, wz * ux - wx * uz, wx * uy - wy * ux
    ax, ay, az = (
        xx * vx + xy * vy + xz * vz,
        xy * vx + yy * vy + yz * vz,
        xz * vx + yz * vy + zz * vz,
    )
    eu = _form(xx, xy, xz, yy, yz, zz, ux, uy, uz)
    uv = ux * ax + uy * ay + uz * az
    ev = vx * ax + vy * ay + vz * az
    if uv != 0.0:  # one Jacobi rotation (Golub & Van Loan, 8.5.2)
        ratio = (ev - eu) / (2.0 * uv)
        t = (1.0 if ratio >= 0.0 else -1.0) / (abs(ratio) + math.sqrt(1.0 + ratio * ratio))
        c = 1.0 / math.sqrt(1.0 + t * t)
        s = t * c
        ux, vx = c * ux - s * vx, s * ux + c * vx
        uy, vy = c * uy - s * vy, s * uy + c * vy
        uz, vz = c * uz - s * vz, s * uz + c * vz
        eu, ev = eu - t * uv, ev + t * uv
    if eu < ev:
        return ev, vx, vy, vz, eu, ux, uy, uz
    return eu, ux, uy, uz, ev, vx, vy, vz


@kernel
def _sign(x, y, z):
    """The sign that makes the largest component positive."""
    largest = x
    if abs(y) > abs(largest):
        largest = y
    if abs(z) > abs(largest):
        largest = z
    return -1.0 if largest < 0.0 else 1.0
