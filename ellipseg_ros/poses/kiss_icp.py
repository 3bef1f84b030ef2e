"""Poses of clouds by KISS-ICP (Vizzo et al., RA-L 2023), run on the spot.

The package kiss-icp of PyPI: robust without tuning, and an odometry is no part of this project.
"""

from collections.abc import Iterable

import numpy as np

from ellipseg_ros.errors import InputError, missing_package
from ellipseg_ros.poses.point_times import point_times
from ellipseg_ros.poses.series import PoseSample
from ellipseg_ros.poses.transforms import from_matrix
from ellipseg_ros.records import Array, Sweep

KISS_ICP = "kiss-icp"
FIXED_FRAME = "odom"


def kiss_icp_poses(clouds: Iterable[Sweep]) -> list[PoseSample]:
    """Poses of the sensor at the end of every cloud; deskewed where points have times.

    Raises InputError if kiss-icp is not installed.
    """
    try:
        from kiss_icp.config import load_config
        from kiss_icp.kiss_icp import KissICP
    except ModuleNotFoundError as error:
        raise InputError(f"--odometry {KISS_ICP} {missing_package(error)}", "package") from error
    odometry = KissICP(load_config(None))
    samples = []
    for cloud in clouds:
        finite = np.isfinite(cloud.points).all(axis=1)
        offsets = _offsets(cloud)
        times = offsets[finite]
        span = float(np.ptp(times)) if len(times) else 0.0
        scaled = (times - times.min()) / span if span else np.zeros(0)
        odometry.register_frame(cloud.points[finite], scaled)
        end_ns = cloud.stamp_ns + int(offsets.max(initial=0) if span else 0)
        samples.append(PoseSample(end_ns, FIXED_FRAME, "", from_matrix(odometry.last_pose)))
    return samples


def _offsets(cloud: Sweep) -> Array:
    if cloud.fields is None:
        return np.zeros(len(cloud), np.int64)
    return point_times(cloud.fields, cloud.stamp_ns).offsets_ns
