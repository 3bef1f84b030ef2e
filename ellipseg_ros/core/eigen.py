"""Eigenvalues and axes of symmetric 3x3 matrices, in closed form."""

import math
from typing import Any

from ellipseg_ros.core.jit import kernel


@kernel
def eigen(out: Any, row: Any, matrix: int, values: int, axes: int) -> None:
    """Decompose a symmetric matrix within a row of an array.

    out[row, matrix:matrix + 6] holds xx, xy, xz, yy, yz, zz; out[row, values:values + 3] gets the
    eigenvalues, descending, clipped at 0; out[row, axes:axes + 9] the axes v1, v2, v3: largest
    component of v1 and of v2 positive, v3 = v1 x v2. The identity where all eigenvalues are 0.

    Trigonometric roots (Smith 1961), the axis of the most separate one by cross products, the other
    two by one rotation within its complement (Eberly, "A Robust Eigensolver for 3x3 Symmetric
    Matrices", 2014), eigenvalues as Rayleigh quotients: accurate to a few ulp of the largest.
    """
    xx, xy, xz = out[row, matrix], out[row, matrix + 1], out[row, matrix + 2]
    yy, yz, zz = out[row, matrix + 3], out[row, matrix + 4], out[row, matrix + 5]
    scale = max(abs(xx), abs(yy), abs(zz), max(abs(xy), abs(xz), abs(yz)))
    if not scale > 0.0:
        for k in range(3):
            out[row, values + k] = 0.0
        for k in range(9):
            out[row, axes + k] = 1.0 if k % 4 == 0 else 0.0
        return
    xx, xy, xz, yy, yz, zz = xx / scale, xy / scale, xz / scale, yy / scale, yz / scale, zz / scale
    off = xy * xy + xz * xz + yz * yz
    wx, wy, wz = 1.0, 0.0, 0.0
    middle = (xx + yy + zz) / 3.0
    bx, by, bz = xx - middle, yy - middle, zz - middle
    spread = math.sqrt((bx * bx + by * by + bz * bz + 2.0 * off) / 6.0)
    if spread > 0.0:
        half = (
            bx * (by * bz - yz * yz) - xy * (xy * bz - yz * xz) + xz * (xy * yz - by * xz)
        ) / (2.0 * spread * spread * spread)
        angle = math.acos(min(1.0, max(-1.0, half))) / 3.0
        if half < 0.0:
            angle += 2.0943951023931953  # 2 pi / 3: the smallest root is the separate one
        root = 2.0 * spread * math.cos(angle)
        ax, ay, az = bx - root, by - root, bz - root
        # Cross products of the rows of A - root I: the longest is the best conditioned.
        px, py, pz = xy * yz - xz * ay, xz * xy - ax * yz, ax * ay - xy * xy
        qx, qy, qz = xy * az - xz * yz, xz * xz - ax * az, ax * yz - xy * xz
        rx, ry, rz = ay * az - yz * yz, yz * xz - xy * az, xy * yz - ay * xz
        p2 = px * px + py * py + pz * pz
        q2 = qx * qx + qy * qy + qz * qz
        r2 = rx * rx + ry * ry + rz * rz
        if p2 >= q2 and p2 >= r2:
            wx, wy, wz, length = px, py, pz, p2
        elif q2 >= r2:
            wx, wy, wz, length = qx, qy, qz, q2
        else:
            wx, wy, wz, length = rx, ry, rz, r2
        if length > 0.0:
            length = math.sqrt(length)
            wx, wy, wz = wx / length, wy / length, wz / length
        else:
            wx, wy, wz = 1.0, 0.0, 0.0
    # An orthonormal complement u, v of w, and the matrix within it.
    if abs(wx) > abs(wy):
        length = math.sqrt(wx * wx + wz * wz)
        ux, uy, uz = -wz / length, 0.0, wx / length
    else:
        length = math.sqrt(wy * wy + wz * wz)
        ux, uy, uz = 0.0, wz / length, -wy / length
    vx, vy, vz = wy * uz - wz * uy, wz * ux - wx * uz, wx * uy - wy * ux
    aux, auy, auz = xx * ux + xy * uy + xz * uz, xy * ux + yy * uy + yz * uz, xz * ux + yz * uy + zz * uz
    avx, avy, avz = xx * vx + xy * vy + xz * vz, xy * vx + yy * vy + yz * vz, xz * vx + yz * vy + zz * vz
    uu = ux * aux + uy * auy + uz * auz
    uv = ux * avx + uy * avy + uz * avz
    vv = vx * avx + vy * avy + vz * avz
    ew = (
        wx * (xx * wx + xy * wy + xz * wz)
        + wy * (xy * wx + yy * wy + yz * wz)
        + wz * (xz * wx + yz * wy + zz * wz)
    )
    if uv != 0.0:  # one Jacobi rotation (Golub & Van Loan, 8.5.2)
        ratio = (vv - uu) / (2.0 * uv)
        t = (1.0 if ratio >= 0.0 else -1.0) / (abs(ratio) + math.sqrt(1.0 + ratio * ratio))
        c = 1.0 / math.sqrt(1.0 + t * t)
        s = t * c
        ux, vx = c * ux - s * vx, s * ux + c * vx
        uy, vy = c * uy - s * vy, s * uy + c * vy
        uz, vz = c * uz - s * vz, s * uz + c * vz
        uu, vv = uu - t * uv, vv + t * uv
    # Descending: (uu, u) >= (vv, v), then w to its place.
    if uu < vv:
        uu, vv, ux, uy, uz, vx, vy, vz = vv, uu, vx, vy, vz, ux, uy, uz
    if ew >= uu:
        e1, e2, e3 = ew, uu, vv
        ax, ay, az, bx, by, bz = wx, wy, wz, ux, uy, uz
    elif ew >= vv:
        e1, e2, e3 = uu, ew, vv
        ax, ay, az, bx, by, bz = ux, uy, uz, wx, wy, wz
    else:
        e1, e2, e3 = uu, vv, ew
        ax, ay, az, bx, by, bz = ux, uy, uz, vx, vy, vz
    sign = _sign(ax, ay, az)
    ax, ay, az = sign * ax, sign * ay, sign * az
    sign = _sign(bx, by, bz)
    bx, by, bz = sign * bx, sign * by, sign * bz
    out[row, values] = max(0.0, e1 * scale)
    out[row, values + 1] = max(0.0, e2 * scale)
    out[row, values + 2] = max(0.0, e3 * scale)
    out[row, axes], out[row, axes + 1], out[row, axes + 2] = ax, ay, az
    out[row, axes + 3], out[row, axes + 4], out[row, axes + 5] = bx, by, bz
    out[row, axes + 6] = ay * bz - az * by
    out[row, axes + 7] = az * bx - ax * bz
    out[row, axes + 8] = ax * by - ay * bx


@kernel
def _sign(x: Any, y: Any, z: Any) -> Any:
    """The sign that makes the largest component positive."""
    largest = x
    if abs(y) > abs(largest):
        largest = y
    if abs(z) > abs(largest):
        largest = z
    return -1.0 if largest < 0.0 else 1.0
