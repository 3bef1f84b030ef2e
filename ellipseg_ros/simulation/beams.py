"""Casting of the beams of a sweep, and what the lidar measures.

All random numbers are hashes of a beam's key, so that no result depends on order, threads or the
part of the world that is loaded. Leaves have fixed places in the world: a porous body returns
beams from the same parts in every sweep.
"""

from typing import NamedTuple

import numpy as np

from ellipseg_ros.core.jit import for_parts, inlined, kernel
from ellipseg_ros.records import Array
from ellipseg_ros.simulation.grid import (
    AXES,
    CELL,
    DENSITY,
    FORM,
    HIGH,
    LOW,
    NODES,
    RADIUS,
    SIZE,
    STEP,
    WINDOWS,
    Grid,
)
from ellipseg_ros.simulation.rays import (
    FAR,
    GROUND,
    LEAF_COSINE,
    NOTHING,
    intersect_box,
    intersect_cone,
    intersect_ellipsoid,
)
from ellipseg_ros.simulation.shapes import BOX, CONE

LEAF = 0.15  # m: edge of the cubes that are full of leaves or empty
CLUMP = 4  # cubes along a clump of leaves
CLUMPS = 0.45  # share of the clumps that hold leaves
PASS = 0.5  # share of beams that pass a cube of leaves
PART = 64  # lines that a thread casts at once
FIRST_NUMBER = 1 << 20  # of the random numbers of a beam; ray casting uses the lower ones
MIXED_GAP = (0.2, 1.5)  # m: a beam on an edge between such ranges may return a mean of both


class Movers(NamedTuple):
    """Items that move in a straight line while a sweep lasts."""

    begin: Array  # (m, 4) float64: x, y, z (m) and yaw (rad) at the beginning of the sweep
    end: Array  # (m, 4): at its end
    radius: Array  # (m,) m: about the position
    starts: Array  # (m + 1,) int64: rows of `table`
    table: Array  # (q, WIDTH): bodies in the frame of their item


class Beams(NamedTuple):
    """Beams of a sweep: a row per line, fired at one time, and a column per beam of the line."""

    origin: Array  # (l, 3) m, world
    rotation: Array  # (l, 3, 3) sensor to world
    direction: Array  # (l, b, 3) unit vectors in the sensor's frame
    reach: float  # m
    key: np.uint64  # of the first beam; the others count on from it


class Ends(NamedTuple):
    """Ends of the beams, by line and beam."""

    distance: Array  # (l, b) float64 m; FAR if there is none
    body: Array  # (l, b) int64: row of the grid's table, then of the movers'; GROUND or NOTHING
    cosine: Array  # (l, b) float64: of the angle of incidence


def cast_beams(beams: Beams, grid: Grid, movers: Movers) -> Ends:
    """The end of every beam; beams must not leave the grid within their reach."""
    size = beams.direction.shape[:2]
    ends = Ends(np.full(size, FAR), np.full(size, NOTHING, np.int64), np.zeros(size))
    parts = [(k, min(k + PART, size[0])) for k in range(0, size[0], PART)]
    for_parts(parts, _cast, beams, grid, movers, ends)
    return ends


@kernel
def uniform(key, number):
    """A number in 0...1, the given one of those that belong to a key (uint64).

    Source: splitmix64, Steele, Lea & Flood (OOPSLA 2014).
    """
    x = key * np.uint64(0xD1342543DE82EF95) + np.uint64(number) * np.uint64(0x9E3779B97F4A7C15)
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    x = x ^ (x >> np.uint64(31))
    return np.float64(x >> np.uint64(11)) * 2.0**-53


@kernel
def _cast(start, stop, beams, grid, movers, ends):
    pose, near = np.empty((len(movers.begin), 5)), np.empty(len(movers.begin), np.int64)
    lines, count = beams.direction.shape[:2]
    d = np.empty((count, 3))
    for line in range(start, stop):
        o = (beams.origin[line, 0], beams.origin[line, 1], beams.origin[line, 2])
        _rotate(beams.rotation[line], beams.direction[line], d)
        _place(movers, line / lines, pose)
        selected = near[: _select(o, d, pose, movers.radius, near)]
        for b in range(count):
            beam, key = (d[b, 0], d[b, 1], d[b, 2]), beams.key + np.uint64(line * count + b)
            best, body, cosine = _nearest_mover(o, beam, pose, selected, movers, beams.reach)
            if body >= 0:
                body += len(grid.table)
            end, static, static_cosine = _first_static(o, beam, key, grid, best)
            if static != NOTHING:
                best, body, cosine = end, static, static_cosine
            if body != NOTHING:
                ends.distance[line, b] = best
                ends.body[line, b] = body
                ends.cosine[line, b] = cosine


@kernel
def _rotate(r, directions, rotated):
    """Set the rows of `rotated` to r times the rows of `directions`."""
    for b in range(len(directions)):
        x, y, z = directions[b, 0], directions[b, 1], directions[b, 2]
        for k in range(3):
            rotated[b, k] = r[k, 0] * x + r[k, 1] * y + r[k, 2] * z


@kernel
def _place(movers, share, pose):
    """Set the rows of `pose` to x, y, z, cos and sin of yaw at a share of the sweep."""
    for m in range(len(pose)):
        for k in range(3):
            pose[m, k] = movers.begin[m, k] + share * (movers.end[m, k] - movers.begin[m, k])
        yaw = movers.begin[m, 3] + share * (movers.end[m, 3] - movers.begin[m, 3])
        pose[m, 3], pose[m, 4] = np.cos(yaw), np.sin(yaw)


@kernel
def _select(o, directions, pose, radius, near):
    """Fill `near` with the movers that touch the cone around a line's beams; return how many."""
    x, y, z = directions[:, 0].sum(), directions[:, 1].sum(), directions[:, 2].sum()
    norm = np.sqrt(x * x + y * y + z * z)
    x, y, z = x / norm, y / norm, z / norm
    narrowest = 1.0  # cosine of the opening
    for d in directions:
        narrowest = min(narrowest, d[0] * x + d[1] * y + d[2] * z)
    opening, count = np.arccos(narrowest), 0
    for m in range(len(pose)):
        u, v, w = pose[m, 0] - o[0], pose[m, 1] - o[1], pose[m, 2] - o[2]
        away = np.sqrt(u * u + v * v + w * w)
        inside = away <= radius[m]
        if not inside:
            angle = np.arccos(min(1.0, max(-1.0, (u * x + v * y + w * z) / away)))
            inside = angle <= opening + np.arcsin(radius[m] / away) + 1e-6
        if inside:
            near[count] = m
            count += 1
    return count


@kernel
def _nearest_mover(o, d, pose, near, movers, best):
    """Distance, row of the table and cosine of the nearest moving body within `best`."""
    body, cosine = NOTHING, 0.0
    for m in near:
        x, y, z = o[0] - pose[m, 0], o[1] - pose[m, 1], o[2] - pose[m, 2]
        along, radius = -(x * d[0] + y * d[1] + z * d[2]), movers.radius[m]
        if x * x + y * y + z * z - along * along > radius * radius or along < -radius:
            continue
        c, s = pose[m, 3], pose[m, 4]
        p = (c * x + s * y, c * y - s * x, z)
        v = (c * d[0] + s * d[1], c * d[1] - s * d[0], d[2])
        for row in range(movers.starts[m], movers.starts[m + 1]):
            enter, leave, incidence = _intersect(p, v, movers.table, row, best)
            if 0.0 < enter < leave and enter < best:
                best, body, cosine = enter, row, incidence
    return best, body, cosine


@inlined
def _first_static(o, d, key, grid, best):
    """Distance, body and cosine of the first return within `best` of what does not move."""
    first, _, tops, starts, bodies, table = grid
    body, cosine, t = NOTHING, 0.0, 0.0
    i, j = int(np.floor(o[0] / CELL)), int(np.floor(o[1] / CELL))
    ahead_x, ahead_y = int(d[0] >= 0.0), int(d[1] >= 0.0)
    per_x = 1.0 / d[0] if d[0] != 0.0 else np.inf
    per_y = 1.0 / d[1] if d[1] != 0.0 else np.inf
    t_x, t_y = ((i + ahead_x) * CELL - o[0]) * per_x, ((j + ahead_y) * CELL - o[1]) * per_y
    column, row = i - first[0], j - first[1]
    while t < best and 0 <= column < tops.shape[0] and 0 <= row < tops.shape[1]:
        leave = min(t_x, t_y, best)
        low, high = o[2] + t * d[2], o[2] + leave * d[2]
        if d[2] < 0.0:
            low, high = high, low
        if low < tops[column, row]:
            end = _ground(o, d, t, leave, grid)
            if end < best:
                best, body = end, GROUND
        cell = column * tops.shape[1] + row
        for k in range(starts[cell], starts[cell + 1]):
            b = bodies[k]
            if table[b, LOW] > high or table[b, HIGH] < low:
                continue
            enter, incidence = _return(o, d, key, table, b, best)
            if enter < best:
                best, body, cosine = enter, b, incidence
        t = min(t_x, t_y)
        if t_x < t_y:
            i += 2 * ahead_x - 1
            t_x, column = ((i + ahead_x) * CELL - o[0]) * per_x, i - first[0]
        else:
            j += 2 * ahead_y - 1
            t_y, row = ((j + ahead_y) * CELL - o[1]) * per_y, j - first[1]
    if body == GROUND:
        cosine = _ground_cosine(o, d, best, grid)
    return best, body, cosine


@inlined
def _return(o, d, key, table, b, best):
    """Distance of the return from body b, FAR if there is none within `best`, and cosine."""
    enter, leave, cosine = _intersect(o, d, table, b, best)
    if enter >= leave or leave <= 0.0:
        return FAR, 0.0
    enter = max(enter, 0.0)
    if table[b, DENSITY] > 0.0:
        return _leaf(o, d, enter, min(leave, best), table[b, DENSITY], key), LEAF_COSINE
    return enter, cosine


@inlined
def _intersect(o, d, table, b, best):
    """Like rays._intersect, of row b of the table; empty if it is not within `best`."""
    x, y, z = o[0] - table[b, 0], o[1] - table[b, 1], o[2] - table[b, 2]
    along, radius = -(x * d[0] + y * d[1] + z * d[2]), table[b, RADIUS]
    if along < -radius or along - radius > best:
        return FAR, -FAR, 0.0
    if x * x + y * y + z * z - along * along > radius * radius:
        return FAR, -FAR, 0.0
    p, v = _in_axes(table, b, x, y, z), _in_axes(table, b, d[0], d[1], d[2])
    size = (table[b, SIZE], table[b, SIZE + 1], table[b, SIZE + 2])
    if table[b, FORM] == BOX:
        return intersect_box(p, v, size, table[b, WINDOWS] != 0.0)
    if table[b, FORM] == CONE:
        return intersect_cone(p, v, size)
    return intersect_ellipsoid(p, v, size)


@inlined
def _in_axes(table, b, x, y, z):
    return (
        table[b, AXES] * x + table[b, AXES + 3] * y + table[b, AXES + 6] * z,
        table[b, AXES + 1] * x + table[b, AXES + 4] * y + table[b, AXES + 7] * z,
        table[b, AXES + 2] * x + table[b, AXES + 5] * y + table[b, AXES + 8] * z,
    )


@kernel
def _leaf(o, d, enter, leave, density, key):
    """Distance to the first leaf between two distances along a beam, or FAR.

    A share of the cubes of LEAF holds leaves, always the same ones and in clumps, and a beam is
    stopped with probability 1 - PASS in each of them. On the average of a body's surface, beams
    are stopped at the rate `density` per m; between the clumps they get farther.
    """
    full = (1.0 - np.exp(-density * LEAF)) / ((1.0 - PASS) * CLUMPS)
    t, number = enter + LEAF * uniform(key, 0), 1
    while t < leave:
        x = int(np.floor((o[0] + t * d[0]) / LEAF))
        y = int(np.floor((o[1] + t * d[1]) / LEAF))
        z = int(np.floor((o[2] + t * d[2]) / LEAF))
        if _hash(x, y, z, 0) < full and uniform(key, number) >= PASS:
            if _hash(x // CLUMP, y // CLUMP, z // CLUMP, 1) < CLUMPS:
                return t
        t, number = t + LEAF, number + 1
    return FAR


@kernel
def _hash(x, y, z, number):
    """A number in 0...1 that belongs to a cube of a lattice."""
    cube = np.uint64(x * 73856093) ^ np.uint64(y * 19349663) ^ np.uint64(z * 83492791)
    return uniform(cube, number)


@inlined
def _height(x, y, grid):
    """Height of the ground, interpolated between the nodes."""
    u, v = x / STEP - grid.first[0] * NODES, y / STEP - grid.first[1] * NODES
    i, j = min(int(u), grid.heights.shape[0] - 2), min(int(v), grid.heights.shape[1] - 2)
    u, v = u - i, v - j
    near = grid.heights[i, j] + v * (grid.heights[i, j + 1] - grid.heights[i, j])
    far = grid.heights[i + 1, j] + v * (grid.heights[i + 1, j + 1] - grid.heights[i + 1, j])
    return near + u * (far - near)


@inlined
def _ground(o, d, start, stop, grid):
    """Distance to the ground between two distances along a beam, or FAR."""
    above = o[2] + start * d[2] - _height(o[0] + start * d[0], o[1] + start * d[1], grid)
    t = start
    while t < stop:
        after = min(t + STEP, stop)
        then = o[2] + after * d[2] - _height(o[0] + after * d[0], o[1] + after * d[1], grid)
        if then <= 0.0:
            return t + (after - t) * max(above, 0.0) / (max(above, 0.0) - then + 1e-12)
        t, above = after, then
    return FAR


@kernel
def _ground_cosine(o, d, t, grid):
    x, y = o[0] + t * d[0], o[1] + t * d[1]
    east = (_height(x + STEP, y, grid) - _height(x - STEP, y, grid)) / (2.0 * STEP)
    north = (_height(x, y + STEP, grid) - _height(x, y - STEP, grid)) / (2.0 * STEP)
    return abs(d[2] - east * d[0] - north * d[1]) / np.sqrt(1.0 + east * east + north * north)


@kernel
def measure(ends, reflectivity, key, limits, rates, measured):
    """Set the measured ranges; rates: signal strength, shares of kept and mixed returns, noise."""
    lines, beams = measured.shape
    strength, kept, mixed, noise = rates
    for line in range(lines):
        for b in range(beams):
            distance = ends.distance[line, b]
            if not limits[0] < distance < limits[1]:
                continue
            own = key + np.uint64(line * beams + b)
            signal = strength * reflectivity[line, b] * ends.cosine[line, b] / distance**2
            if uniform(own, FIRST_NUMBER) >= kept * (1.0 - np.exp(-signal)):
                continue
            gap = ends.distance[min(line + 1, lines - 1), b] - distance
            if MIXED_GAP[0] < abs(gap) < MIXED_GAP[1] and uniform(own, FIRST_NUMBER + 1) < mixed:
                distance += uniform(own, FIRST_NUMBER + 2) * gap
            size = np.sqrt(-2.0 * np.log(1.0 - uniform(own, FIRST_NUMBER + 3)))
            turn = 2.0 * np.pi * uniform(own, FIRST_NUMBER + 4)
            measured[line, b] = distance + noise * size * np.cos(turn)
