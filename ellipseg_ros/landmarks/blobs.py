"""Blob landmarks: compact, isolated things, such as a lone bush."""

import numpy as np

from ellipseg_ros.config import LandmarksConfig
from ellipseg_ros.core.disjoint_set import components
from ellipseg_ros.core.jit import kernel
from ellipseg_ros.core.members import group_members, groups_of_points
from ellipseg_ros.core.moments import united
from ellipseg_ros.landmarks.fits import (
    Fits,
    add_to_box,
    count_passes,
    renumber,
    set_moments,
)
from ellipseg_ros.records import Array, SegmentAdjacency

MAX_SIGMA = 0.3  # m: largest standard deviation of a blob
MIN_ROUNDNESS = 0.3  # smallest standard deviation, as a share of the largest
COUNT_FACTOR = 2.5  # times the points of other landmarks: its centre is the mean of what is seen
CENTRE_ERROR = 0.25  # of the centre, by standard deviation: a blob is not seen from all sides


def find_blobs(
    points: Array,
    labels: Array,
    moments: Array,
    adjacency: SegmentAdjacency,
    free: Array,
    config: LandmarksConfig,
) -> tuple[Fits, Array]:
    """Blobs, and the blob of every point (n,) int32, -1 for none.

    They are compact connected components of the segments that are `free` (s,) bool: of no plane
    and no line. points (n, 3) m, local origin; labels (n,) int32: the segment of every point,
    negative for none; moments (s,): of the segments' points.
    """
    joined = free[adjacency.a] & free[adjacency.b]
    roots = components(len(moments), adjacency.a[joined], adjacency.b[joined])
    group = np.full(len(moments), -1, np.int32)
    group[free] = np.unique(roots[free], return_inverse=True)[1].reshape(-1)
    count = int(group.max(initial=-1)) + 1
    fits, point_labels = Fits.empty(count), np.full(len(points), -1, np.int32)
    members = group_members(groups_of_points(labels, group), count)
    _measure(points, members, united(moments[free], group[free], count), fits, point_labels)
    good = (fits.count >= COUNT_FACTOR * config.min_points) & (fits.passes >= config.min_points)
    good &= fits.sigma[:, 0] <= MAX_SIGMA
    good &= fits.sigma[:, 2] >= MIN_ROUNDNESS * fits.sigma[:, 0]
    return fits.select(good), renumber(point_labels, good)


@kernel
def _measure(points, members, moments, fits, point_labels):
    local = np.empty(3)
    for p in range(len(moments)):
        rows = members.rows[members.starts[p] : members.starts[p + 1]]
        fits.count[p], fits.passes[p] = len(rows), count_passes(rows)
        set_moments(moments, p, fits, p)
        for k in range(3):
            variance = moments[p].eigenvalues[2 - k]
            fits.covariance[p, k, k] = variance * (CENTRE_ERROR**2 + 1.0 / max(1, fits.passes[p]))
        for i in rows:
            add_to_box(points, i, fits, p, local)
            point_labels[i] = p
