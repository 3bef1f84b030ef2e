"""Ray casting against shapes and rolling ground.

The common ray casters know triangles and solids, but no bodies that a beam can pass through, such
as foliage and wire mesh.
"""

from typing import NamedTuple

import numpy as np

from ellipseg_ros.core.jit import kernel
from ellipseg_ros.records import Array
from ellipseg_ros.simulation.shapes import BOX, CONE, Shapes

GROUND = -2  # in Returns.body
NOTHING = -1  # in Returns.body
FAR = 1e9  # m: distance of a beam without a return
MAX_GROUND_DISTANCE = 200.0  # m
GOLDEN_RATIO = 0.618033988749895  # spreads one random number of a beam over all bodies
WINDOW_SPACING = 2.8  # m
WINDOW_HALF_SIZE = (0.62, 0.75)  # m: width and height
WINDOW_RECESS = 0.22  # m: from the wall to the pane
GLASS = 0.25  # reflectivity of panes, relative to the wall
LEAF_COSINE = 0.7  # of the angle of incidence on leaves, which have all directions


class Terrain(NamedTuple):
    """Rolling ground: z = sum over k of height_k sin(wave_k (x, y) + phase_k)."""

    height: Array  # (k,) m
    wave: Array  # (k, 2) rad/m
    phase: Array  # (k,) rad
    max_slope: float


class Lines(NamedTuple):
    """Scan lines; the beam at angle a has direction cos(a) forward + sin(a) side."""

    origin: Array  # (l, 3) m
    forward: Array  # (l, 3)
    side: Array  # (l, 3)


class Returns(NamedTuple):
    """Ends of the beams: a row per scan line, a column per beam."""

    distance: Array  # (l, b) float64 m; FAR if there is none
    body: Array  # (l, b) int64: row of the shapes, GROUND or NOTHING
    cosine: Array  # (l, b) float64: of the angle of incidence


def cast(lines: Lines, angles: Array, uniform: Array, shapes: Shapes, terrain: Terrain) -> Returns:
    """The end of every beam.

    angles: (b,) rad. uniform: (l, b) random numbers in 0...1, which decide how deep a beam enters
    porous bodies.
    """
    size = (len(lines.origin), len(angles))
    returns = Returns(np.full(size, FAR), np.full(size, NOTHING, np.int64), np.zeros(size))
    _cast(lines, angles, uniform, shapes, terrain, returns)
    return returns


@kernel
def elevation(terrain, x, y):
    """Height of the ground at x, y; all in m."""
    z = 0.0
    for k in range(len(terrain.height)):
        phase = terrain.wave[k, 0] * x + terrain.wave[k, 1] * y + terrain.phase[k]
        z += terrain.height[k] * np.sin(phase)
    return z


@kernel
def _cast(lines, angles, uniform, shapes, terrain, returns):
    near = np.empty(len(shapes.form), np.int64)
    for line in range(len(lines.origin)):
        o, f, s = lines.origin[line], lines.forward[line], lines.side[line]
        count = _select_bodies(o, f, s, shapes, near)
        for b in range(len(angles)):
            d = np.cos(angles[b]) * f + np.sin(angles[b]) * s
            _nearest_body(o, d, uniform[line, b], shapes, near[:count], (line, b), returns)
            limit = min(returns.distance[line, b], MAX_GROUND_DISTANCE)
            t = _ground_distance(o, d, terrain, limit)
            if t < limit:
                returns.distance[line, b] = t
                returns.body[line, b] = GROUND
                returns.cosine[line, b] = _ground_cosine(o + t * d, d, terrain)


@kernel
def _select_bodies(o, f, s, shapes, near):
    """Fill `near` with the bodies in reach of a scan line; return their number."""
    nx, ny, nz = f[1] * s[2] - f[2] * s[1], f[2] * s[0] - f[0] * s[2], f[0] * s[1] - f[1] * s[0]
    count = 0
    for i in range(len(shapes.form)):
        c, radius = shapes.centre[i], shapes.radius[i]
        x, y, z = c[0] - o[0], c[1] - o[1], c[2] - o[2]
        if abs(nx * x + ny * y + nz * z) <= radius and f[0] * x + f[1] * y + f[2] * z >= -radius:
            near[count] = i
            count += 1
    return count


@kernel
def _nearest_body(o, d, uniform, shapes, near, at, returns):
    """Set the return of one beam from the nearest of the bodies `near`."""
    for i in near:
        c = shapes.centre[i]
        x, y, z = o[0] - c[0], o[1] - c[1], o[2] - c[2]
        ahead = -(x * d[0] + y * d[1] + z * d[2])
        radius = shapes.radius[i]
        if ahead < -radius or ahead - radius > returns.distance[at]:
            continue
        if x * x + y * y + z * z - ahead * ahead > radius * radius:
            continue
        enter, leave, cosine = _intersect(o, d, i, shapes)
        if leave <= 0.0 or enter >= leave:
            continue
        enter = max(enter, 0.0)
        if shapes.density[i] > 0.0:
            chance = (uniform + i * GOLDEN_RATIO) % 1.0
            enter -= np.log(1.0 - chance) / shapes.density[i]
            cosine = LEAF_COSINE
        if enter < leave and enter < returns.distance[at]:
            returns.distance[at] = enter
            returns.body[at] = i
            returns.cosine[at] = cosine


@kernel
def _intersect(o, d, i, shapes):
    """Distances along the beam where it enters and leaves body i, and the cosine of incidence."""
    a, c, size = shapes.axes[i], shapes.centre[i], shapes.size[i]
    x, y, z = o[0] - c[0], o[1] - c[1], o[2] - c[2]
    p, v = in_axes(a, x, y, z), in_axes(a, d[0], d[1], d[2])
    if shapes.form[i] == BOX:
        return intersect_box(p, v, size, shapes.windows[i])
    if shapes.form[i] == CONE:
        return intersect_cone(p, v, size)
    return intersect_ellipsoid(p, v, size)


@kernel
def in_axes(a, x, y, z):
    """A vector in the axes of a body, the columns of `a`."""
    return (
        a[0, 0] * x + a[1, 0] * y + a[2, 0] * z,
        a[0, 1] * x + a[1, 1] * y + a[2, 1] * z,
        a[0, 2] * x + a[1, 2] * y + a[2, 2] * z,
    )


@kernel
def intersect_box(p, v, size, windows):
    """Like _intersect, of a box, with the beam in its axes: position p, direction v."""
    enter, leave, face = -FAR, FAR, 0
    for k in range(3):
        if abs(v[k]) < 1e-12:
            if abs(p[k]) > size[k]:
                return FAR, -FAR, 0.0
            continue
        middle, half = -p[k] / v[k], size[k] / abs(v[k])
        if middle - half > enter:
            enter, face = middle - half, k
        leave = min(leave, middle + half)
    cosine = abs(v[face])
    if windows and face < 2 and 0.0 < enter < leave:
        deeper = enter + WINDOW_RECESS / cosine
        u = p[1 - face] + deeper * v[1 - face]
        up = p[2] + deeper * v[2] + size[2]
        if _in_window(u + size[1 - face], 2.0 * size[1 - face], up, 2.0 * size[2]):
            return deeper, leave, GLASS * cosine
    return enter, leave, cosine


@kernel
def _in_window(u, width, up, height):
    """Whether a position on a wall is a pane; u from its left end, up from its foot, in m."""
    columns, rows = int(width / WINDOW_SPACING), int(height / WINDOW_SPACING)
    if columns == 0 or rows == 0:
        return False
    cell, storey = width / columns, height / rows
    return (
        abs(u % cell - 0.5 * cell) < WINDOW_HALF_SIZE[0]
        and abs(up % storey - 0.55 * storey) < WINDOW_HALF_SIZE[1]
    )


@kernel
def intersect_ellipsoid(p, v, size):
    """Like intersect_box, of an ellipsoid."""
    px, py, pz = p[0] / size[0], p[1] / size[1], p[2] / size[2]
    vx, vy, vz = v[0] / size[0], v[1] / size[1], v[2] / size[2]
    a, b = vx * vx + vy * vy + vz * vz, px * vx + py * vy + pz * vz
    under = b * b - a * (px * px + py * py + pz * pz - 1.0)
    if under <= 0.0:
        return FAR, -FAR, 0.0
    root = np.sqrt(under)
    enter = (-b - root) / a
    x, y, z = px + enter * vx, py + enter * vy, pz + enter * vz
    nx, ny, nz = x / size[0], y / size[1], z / size[2]
    norm = np.sqrt(nx * nx + ny * ny + nz * nz)
    return enter, (root - b) / a, abs(nx * v[0] + ny * v[1] + nz * v[2]) / norm


@kernel
def intersect_cone(p, v, size):
    """Truncated cone along z: radius r(z) = middle + taper z between its flat ends."""
    half = size[2]
    middle, taper = 0.5 * (size[0] + size[1]), 0.5 * (size[1] - size[0]) / half
    r, dr = middle + taper * p[2], taper * v[2]
    a = v[0] * v[0] + v[1] * v[1] - dr * dr
    b = p[0] * v[0] + p[1] * v[1] - r * dr
    under = b * b - a * (p[0] * p[0] + p[1] * p[1] - r * r)
    if under <= 0.0 or a < 1e-9:  # a beam along the cone; its ends are small
        return FAR, -FAR, 0.0
    root = np.sqrt(under)
    enter, leave = (-b - root) / a, (root - b) / a
    cosine = root / np.sqrt(a) / max(1e-9, abs(r + enter * dr))
    if abs(v[2]) > 1e-12:
        middle, span = -p[2] / v[2], half / abs(v[2])
        if middle - span > enter:
            enter, cosine = middle - span, abs(v[2])
        leave = min(leave, middle + span)
    elif abs(p[2]) > half:
        return FAR, -FAR, 0.0
    return enter, leave, min(1.0, cosine)


@kernel
def _ground_distance(o, d, terrain, limit):
    """Distance to the ground, or FAR; in steps that cannot pass it at its maximum slope."""
    closing = terrain.max_slope * np.sqrt(d[0] * d[0] + d[1] * d[1]) - d[2]
    if closing <= 0.0:
        return FAR
    t = 0.0
    while t < limit:
        clearance = o[2] + t * d[2] - elevation(terrain, o[0] + t * d[0], o[1] + t * d[1])
        if clearance < 0.002:
            return t
        t += clearance / closing
    return FAR


@kernel
def _ground_cosine(at, d, terrain):
    x, y = at[0], at[1]
    east = (elevation(terrain, x + 0.05, y) - elevation(terrain, x - 0.05, y)) / 0.1
    north = (elevation(terrain, x, y + 0.05) - elevation(terrain, x, y - 0.05)) / 0.1
    return abs(d[2] - east * d[0] - north * d[1]) / np.sqrt(1.0 + east * east + north * north)
