"""Blobs that can be found again: compact things that stand apart, such as a lone bush."""

import math

import numpy as np

from ellipseg_ros.config import LandmarksConfig
from ellipseg_ros.core.disjoint_set import find
from ellipseg_ros.core.flat_moments import EIGENVALUES, MEAN, V1, V2, V3, united
from ellipseg_ros.core.jit import kernel
from ellipseg_ros.core.members import Members, members
from ellipseg_ros.landmarks.fits import Fits, no_fits, passages
from ellipseg_ros.records import Array, SegmentAdjacency

LARGEST = 0.3  # m: greatest standard deviation of a blob
ROUND = 0.3  # least one, as a share of the greatest
MANY = 2.5  # times the points of other landmarks: a blob's centre is the mean of what is seen
ONE_SIDE = 0.25  # error of the centre by standard deviation: a blob is not seen from all sides


def find_blobs(
    points: Array, labels: Array, own: Array, adjacency: SegmentAdjacency, free: Array
) -> tuple[Fits, Members]:
    """All that hangs together of the segments that are `free` (s,): of no plane and no line.

    points (n, 3) m, local origin; labels (n,) int32, negative for none; own (s, 24).
    """
    above = np.arange(len(own), dtype=np.int32)
    _connect(adjacency.a, adjacency.b, free, above)
    group = np.full(len(own), -1, np.int32)
    group[free] = np.unique(above[free], return_inverse=True)[1].reshape(-1)
    count = int(group.max(initial=-1)) + 1
    nodes = united(own[free], group[free], count)
    inside = members(labels, group, count)
    fits = no_fits(count)
    _measure(points, inside, nodes, fits)
    return fits, inside


def compact(fits: Fits, config: LandmarksConfig) -> Array:
    """(c,) bool: which of what hangs together is a landmark."""
    good = (fits.count >= MANY * config.min_points) & (fits.passages >= config.min_points)
    good &= (fits.sigma[:, 0] <= LARGEST) & (fits.sigma[:, 2] >= ROUND * fits.sigma[:, 0])
    return np.asarray(good)


@kernel
def _connect(a, b, free, above):
    for pair in range(len(a)):
        if free[a[pair]] and free[b[pair]]:
            one, other = find(above, a[pair]), find(above, b[pair])
            above[max(one, other)] = min(one, other)


@kernel
def _measure(points, inside, nodes, fits):
    for p in range(len(nodes)):
        rows = inside.rows[inside.starts[p] : inside.starts[p + 1]]
        fits.count[p], fits.passages[p] = len(rows), passages(rows)
        for k in range(3):
            fits.position[p, k] = nodes[p, MEAN + k]
            fits.axes[p, k, 0] = nodes[p, V1 + k]
            fits.axes[p, k, 1] = nodes[p, V2 + k]
            fits.axes[p, k, 2] = nodes[p, V3 + k]
            variance = nodes[p, EIGENVALUES + 2 - k]
            fits.sigma[p, k] = math.sqrt(variance)
            fits.covariance[p, k, k] = variance * (ONE_SIDE**2 + 1.0 / max(1, fits.passages[p]))
            fits.low[p, k], fits.high[p, k] = np.inf, -np.inf
        for i in rows:
            for k in range(3):
                along = 0.0
                for c in range(3):
                    along += fits.axes[p, c, k] * (points[i, c] - fits.position[p, c])
                fits.low[p, k] = min(fits.low[p, k], along)
                fits.high[p, k] = max(fits.high[p, k], along)
