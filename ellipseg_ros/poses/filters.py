"""Filters in the sensor's frame: returns too near, too far, or from the vehicle itself."""

import numpy as np

from ellipseg_ros.core.jit import kernel
from ellipseg_ros.records import Array


def filtered(points: Array, limits: tuple[float, float], box: Array) -> tuple[Array, Array]:
    """Ranges (n,) float64, m, and which points are kept (n,) bool.

    points (n, 3) m, sensor frame; limits: least and greatest range, m; box (2, 3) m: corners of a
    box whose points are not kept. Points that are not finite are kept: the window counts them.
    """
    ranges, keep = np.empty(len(points)), np.empty(len(points), bool)
    _filter(points, limits, box, ranges, keep)
    return ranges, keep


@kernel
def _filter(points, limits, box, ranges, keep):
    low, high = limits
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        r = np.sqrt(x * x + y * y + z * z)
        ranges[i] = r
        inside = True
        for axis in range(3):
            inside = inside and box[0, axis] <= points[i, axis] <= box[1, axis]
        keep[i] = not np.isfinite(r) or not (r < low or high < r or inside)
