"""Index of a scene for ray casting: bodies in upright columns, the ground as a height field."""

from typing import NamedTuple

import numpy as np

from ellipseg_ros.core.jit import kernel
from ellipseg_ros.records import Array
from ellipseg_ros.simulation.rays import Terrain, elevation
from ellipseg_ros.simulation.shapes import CONE, ELLIPSOID, Shapes

CELL = 2.0  # m: edge of a column
NODES = 8  # intervals of the height field per column
STEP = CELL / NODES  # m
# Columns of Grid.table: centre, these, half size, axes by rows; what is read most comes first.
RADIUS, LOW, HIGH, DENSITY, FORM, WINDOWS, SIZE = range(3, 10)
AXES, WIDTH = SIZE + 3, SIZE + 12


class Grid(NamedTuple):
    """The bodies and the ground around the scanner."""

    first: Array  # (2,) int64: x and y of the first column, in columns from the origin
    heights: Array  # (8 nx + 1, 8 ny + 1) float64 m: the ground, every STEP
    tops: Array  # (nx, ny) m: highest ground of a column
    starts: Array  # (nx ny + 1,) int64: bodies[starts[i]:starts[i + 1]] are those of column i
    bodies: Array  # (e,) int64: row of `table`
    table: Array  # (p, WIDTH) float64: geometry of the bodies


def make_grid(shapes: Shapes, terrain: Terrain, middle: Array, reach: float) -> Grid:
    """The grid of everything within `reach` m of `middle` (2,), in x and in y."""
    first = np.floor((middle - reach) / CELL).astype(np.int64)
    size = np.ceil((middle + reach) / CELL).astype(np.int64) - first
    x, y = ((first[k] * NODES + np.arange(size[k] * NODES + 1)) * STEP for k in (0, 1))
    heights = _heights(terrain, x, y)
    pairs = np.maximum(heights[:-1], heights[1:])
    corners = np.maximum(pairs[:, :-1], pairs[:, 1:])
    tops = corners.reshape(size[0], NODES, size[1], NODES).max(axis=(1, 3))
    half = _half_extents(shapes)
    low = np.floor((shapes.centre - half)[:, :2] / CELL).astype(np.int64) - first
    high = np.floor((shapes.centre + half)[:, :2] / CELL).astype(np.int64) - first
    starts, bodies = _fill(np.clip(low, 0, None), np.minimum(high, size - 1), size)
    return Grid(first, heights, tops, starts, bodies, make_table(shapes))


def make_table(shapes: Shapes) -> Array:
    """Geometry of bodies as (p, WIDTH) float64."""
    half = _half_extents(shapes)[:, 2]
    z = shapes.centre[:, 2]
    limits = (shapes.radius, z - half, z + half, shapes.density, shapes.form, shapes.windows)
    axes = shapes.axes.reshape(-1, 9)
    return np.column_stack([shapes.centre, *limits, shapes.size, axes]).astype(np.float64)


def _half_extents(shapes: Shapes) -> Array:
    """Half edges (p, 3) m of boxes around the bodies along the axes of the world."""
    size = shapes.size.copy()
    cone = shapes.form == CONE
    size[cone, :2] = size[cone, :2].max(axis=1, keepdims=True)
    reach = np.abs(shapes.axes) * size[:, None, :]
    round_ = np.sqrt(np.sum(reach**2, axis=2))
    half = np.where((shapes.form == ELLIPSOID)[:, None], round_, reach.sum(axis=2))
    return np.asarray(half + 0.001)


@kernel
def _heights(terrain, x, y):
    """Height (m, n) of the ground at all pairs of x (m,) and y (n,), see rays.elevation."""
    z = np.zeros((len(x), len(y)))
    for k in range(len(terrain.height)):
        if terrain.height[k] == 0.0:
            continue
        a, b = terrain.wave[k, 0] * x + terrain.phase[k], terrain.wave[k, 1] * y
        sin_a, cos_a = terrain.height[k] * np.sin(a), terrain.height[k] * np.cos(a)
        sin_b, cos_b = np.sin(b), np.cos(b)
        for i in range(len(x)):
            for j in range(len(y)):
                z[i, j] += sin_a[i] * cos_b[j] + cos_a[i] * sin_b[j]
    return z


@kernel
def _fill(low, high, size):
    """Rows of bodies by column, as starts and bodies of Grid."""
    starts = np.zeros(size[0] * size[1] + 1, np.int64)
    for b in range(len(low)):
        for i in range(low[b, 0], high[b, 0] + 1):
            for j in range(low[b, 1], high[b, 1] + 1):
                starts[i * size[1] + j + 1] += 1
    starts = np.cumsum(starts)
    bodies, filled = np.empty(starts[-1], np.int64), starts.copy()
    for b in range(len(low)):
        for i in range(low[b, 0], high[b, 0] + 1):
            for j in range(low[b, 1], high[b, 1] + 1):
                bodies[filled[i * size[1] + j]] = b
                filled[i * size[1] + j] += 1
    return starts, bodies


@kernel
def elevations(terrain, x, y):
    """rays.elevation at positions x, y (n,)."""
    z = np.empty(len(x))
    for k in range(len(x)):
        z[k] = elevation(terrain, x[k], y[k])
    return z
