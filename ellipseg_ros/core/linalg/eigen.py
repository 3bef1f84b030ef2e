"""Eigenvalues and axes of symmetric 3x3 matrices, in closed form."""

import math

from ellipseg_ros.core.jit import inlined, kernel
from ellipseg_ros.core.linalg.vectors import combined, cross, dot, scaled

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
    w = _separate_axis(xx, xy, xz, yy, yz, zz)
    matrix = (xx, xy, xz), (xy, yy, yz), (xz, yz, zz)
    ew = dot(w, _product(matrix, w))
    eu, u, ev, v = _complement(matrix, w)
    if ew >= eu:
        e1, a, e2, b, e3 = ew, w, eu, u, ev
    elif ew >= ev:
        e1, a, e2, b, e3 = eu, u, ew, w, ev
    else:
        e1, a, e2, b, e3 = eu, u, ev, v, ew
    a, b = scaled(_sign(a[0], a[1], a[2]), a), scaled(_sign(b[0], b[1], b[2]), b)
    e1, e2, e3 = max(0.0, e1 * scale), max(0.0, e2 * scale), max(0.0, e3 * scale)
    c = cross(a, b)
    return e1, e2, e3, (a[0], a[1], a[2], b[0], b[1], b[2], c[0], c[1], c[2])


@kernel
def least_eigenvalue(xx, xy, xz, yy, yz, zz):
    """The least eigenvalue of a symmetric matrix, at least 0, without the axes: four times faster.

    Smith's root (1961), then a step of Newton's on the characteristic polynomial. In error by at
    most 1e-9 of the largest eigenvalue, at twofold ones; else by some ulp of it.
    """
    middle, spread, det, half = _characteristic(xx, xy, xz, yy, yz, zz)
    if not spread > 0.0:
        return max(0.0, middle)
    root = 2.0 * spread * math.cos(math.acos(half) / 3.0 + THIRD)
    # x^3 - 3 spread^2 x - det = 0 for x = root
    slope = 3.0 * (root * root - spread * spread)
    if slope > 1e-6 * spread * spread:
        root -= (root * (root * root - 3.0 * spread * spread) - det) / slope
    return max(0.0, middle + root)


@inlined
def _characteristic(xx, xy, xz, yy, yz, zz):
    """Mean, spread, determinant and cosine for the trigonometric roots of the eigenvalues.

    With mean m and spread s they are m + 2 s cos((acos(cosine) + 2 pi k) / 3); the determinant is
    that of A - m I.
    Source: Smith, Eigenvalues of a symmetric 3x3 matrix (1961).
    """
    middle = (xx + yy + zz) / 3.0
    bx, by, bz = xx - middle, yy - middle, zz - middle
    off = xy * xy + xz * xz + yz * yz
    spread = math.sqrt((bx * bx + by * by + bz * bz + 2.0 * off) / 6.0)
    if not spread > 0.0:
        return middle, 0.0, 0.0, 0.0
    det = bx * (by * bz - yz * yz) - xy * (xy * bz - yz * xz) + xz * (xy * yz - by * xz)
    half = min(1.0, max(-1.0, det / (2.0 * spread * spread * spread)))
    return middle, spread, det, half


@kernel
def _separate_axis(xx, xy, xz, yy, yz, zz):
    """Unit axis of the eigenvalue farther from the middle one, by its trigonometric root."""
    middle, spread, _, half = _characteristic(xx, xy, xz, yy, yz, zz)
    if not spread > 0.0:
        return 1.0, 0.0, 0.0
    angle = math.acos(half) / 3.0 + (THIRD if half < 0.0 else 0.0)
    root = 2.0 * spread * math.cos(angle)
    # Cross products of the rows of A - root I: the longest is the best conditioned.
    first = xx - middle - root, xy, xz
    second = xy, yy - middle - root, yz
    third = xz, yz, zz - middle - root
    p, q, r = cross(first, second), cross(first, third), cross(second, third)
    p2, q2, r2 = dot(p, p), dot(q, q), dot(r, r)
    if q2 > p2 and q2 >= r2:
        p, p2 = q, q2
    elif r2 > p2:
        p, p2 = r, r2
    if not p2 > 0.0:
        return 1.0, 0.0, 0.0
    return scaled(1.0 / math.sqrt(p2), p)


@inlined
def _product(matrix, w):
    """Matrix, as three rows, times vector."""
    return dot(matrix[0], w), dot(matrix[1], w), dot(matrix[2], w)


@kernel
def _complement(matrix, w):
    """The other two eigenvalues, descending, each before its axis; w: the axis of the first."""
    if abs(w[0]) > abs(w[1]):
        u = scaled(1.0 / math.sqrt(w[0] * w[0] + w[2] * w[2]), (-w[2], 0.0, w[0]))
    else:
        u = scaled(1.0 / math.sqrt(w[1] * w[1] + w[2] * w[2]), (0.0, w[2], -w[1]))
    v = cross(w, u)
    image = _product(matrix, v)
    eu, uv, ev = dot(u, _product(matrix, u)), dot(u, image), dot(v, image)
    if uv != 0.0:  # one Jacobi rotation (Golub & Van Loan, 8.5.2)
        ratio = (ev - eu) / (2.0 * uv)
        t = (1.0 if ratio >= 0.0 else -1.0) / (abs(ratio) + math.sqrt(1.0 + ratio * ratio))
        c = 1.0 / math.sqrt(1.0 + t * t)
        s = t * c
        u, v = combined(scaled(c, u), -s, v), combined(scaled(s, u), c, v)
        eu, ev = eu - t * uv, ev + t * uv
    if eu < ev:
        return ev, v, eu, u
    return eu, u, ev, v


@kernel
def _sign(x, y, z):
    """The sign that makes the largest component positive."""
    largest = x
    if abs(y) > abs(largest):
        largest = y
    if abs(z) > abs(largest):
        largest = z
    return -1.0 if largest < 0.0 else 1.0
