"""Coordinates of points: which are measurements, and the origin near them."""

import numpy as np

from ellipseg_ros.core.jit import kernel
from ellipseg_ros.records import REJECTED, Array

MAX_COORDINATE_M = 1e8  # beyond is no measurement (the Earth's radius is 6.4e6 m)
ACCEPTED = 0  # fate of a point that is neither REJECTED nor THINNED
ORIGIN_SAMPLE = 1000  # points whose median gives the origin


@kernel
def check_points(points, fates):
    """Reject points that are not finite, or too far to be real; returns how many are left."""
    count = 0
    for i in range(len(points)):
        good = True
        for axis in range(3):
            good = good and abs(points[i, axis]) <= MAX_COORDINATE_M  # NaN is not
        fates[i] = ACCEPTED if good else REJECTED
        count += good
    return count


def origin_near(points: Array) -> Array | None:
    """Median of a sample, in whole kilometres: subtracting it is exact; zero near zero."""
    if not len(points):
        return None
    sample = points[:: len(points) // ORIGIN_SAMPLE + 1]
    kilometres: Array = np.floor(np.median(sample, axis=0) / 1000.0 + 0.5)
    return kilometres * 1000.0
