"""Initial ellipsoids of points, and the moments and times of the points of segments."""

import numpy as np

from ellipseg_ros.core.jit import for_rows, kernel
from ellipseg_ros.core.linalg.vectors import difference, row
from ellipseg_ros.core.moments import add_products, no_moments, shape
from ellipseg_ros.records import Array


def initial_ellipsoids(points: Array, knn_indices: Array, rows: Array, moments: Array) -> None:
    """Set `rows` (r,) of `moments` to those over N(i): point i and its neighbours, with count 1.

    points (n, 3) m; knn_indices (n, k) int32, -1 for none. Paper, eqs. 2-5.
    """
    for_rows(_initial_ellipsoids, len(rows), points, knn_indices, rows, moments)


def segment_moments(points: Array, labels: Array, previous: Array, cached: Array) -> Array:
    """Moments (s,) of the points of segments; points (n, 3) m, labels (n,) int32, -1 for none.

    previous (s,): row of `cached`, the moments of the last update, of the segment with the same
    points, else -1. Sums run in the order of the points, about the first: exact to an ulp of the
    extent.
    """
    moments, changed = no_moments(len(previous)), previous < 0
    moments[~changed] = cached[previous[~changed]]
    _sum_points(points, labels, changed, moments)
    for_rows(_shapes, len(previous), changed, moments)
    return moments


def segment_times(times_ns: Array, labels: Array, previous: Array, cached: Array) -> Array:
    """Times (s, 2) of the oldest and the newest point of segments; times_ns (n,) int64, ns.

    labels, previous, cached: as for `segment_moments`.
    """
    limits, changed = np.iinfo(np.int64), previous < 0
    spans = np.where(changed[:, None], [limits.max, limits.min], 0)
    spans[~changed] = cached[previous[~changed]]
    _times(times_ns, labels, changed, spans)
    return spans


@kernel
def _initial_ellipsoids(start, stop, points, knn_indices, rows, moments):
    k = knn_indices.shape[1]
    for r in range(start, stop):
        i = rows[r]
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        mx = my = mz = 0.0
        n = 1
        for slot in range(k):
            j = knn_indices[i, slot]
            if j < 0:
                break
            n += 1
            mx += points[j, 0] - x
            my += points[j, 1] - y
            mz += points[j, 2] - z
        mx, my, mz = mx / n, my / n, mz / n
        xx, xy, xz, yy, yz, zz = mx * mx, mx * my, mx * mz, my * my, my * mz, mz * mz  # i itself
        for slot in range(n - 1):
            j = knn_indices[i, slot]
            dx, dy, dz = points[j, 0] - x - mx, points[j, 1] - y - my, points[j, 2] - z - mz
            xx += dx * dx
            xy += dx * dy
            xz += dx * dz
            yy += dy * dy
            yz += dy * dz
            zz += dz * dz
        m = moments[i]
        m.count = 1.0
        m.mean_x, m.mean_y, m.mean_z = x + mx, y + my, z + mz
        m.xx, m.xy, m.xz, m.yy, m.yz, m.zz = xx / n, xy / n, xz / n, yy / n, yz / n, zz / n
        shape(moments, i)


@kernel
def _sum_points(points, labels, changed, moments):
    """Set count, mean and covariance of the changed segments."""
    first = np.zeros((len(moments), 3))
    for i in range(len(points)):
        s = labels[i]
        if s < 0 or not changed[s]:
            continue
        m = moments[s]
        if m.count == 0.0:
            first[s, 0], first[s, 1], first[s, 2] = points[i, 0], points[i, 1], points[i, 2]
        m.count += 1.0
        m.mean_x += points[i, 0] - first[s, 0]
        m.mean_y += points[i, 1] - first[s, 1]
        m.mean_z += points[i, 2] - first[s, 2]
    for s in range(len(moments)):
        if changed[s]:
            m = moments[s]
            m.mean_x = first[s, 0] + m.mean_x / m.count
            m.mean_y = first[s, 1] + m.mean_y / m.count
            m.mean_z = first[s, 2] + m.mean_z / m.count
    for i in range(len(points)):
        s = labels[i]
        if s < 0 or not changed[s]:
            continue
        m = moments[s]
        add_products(m, difference(row(points, i), (m.mean_x, m.mean_y, m.mean_z)))
    for s in range(len(moments)):
        if changed[s]:
            m = moments[s]
            m.xx, m.xy, m.xz = m.xx / m.count, m.xy / m.count, m.xz / m.count
            m.yy, m.yz, m.zz = m.yy / m.count, m.yz / m.count, m.zz / m.count


@kernel
def _shapes(start, stop, changed, moments):
    for s in range(start, stop):
        if changed[s]:
            shape(moments, s)


@kernel
def _times(times_ns, labels, changed, spans):
    for i in range(len(times_ns)):
        s = labels[i]
        if s >= 0 and changed[s]:
            spans[s, 0] = min(spans[s, 0], times_ns[i])
            spans[s, 1] = max(spans[s, 1], times_ns[i])
