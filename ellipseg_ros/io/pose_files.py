"""Trajectories from text files, in the forms of TUM and of KITTI."""

from pathlib import Path

import numpy as np

from ellipseg_ros.errors import InputError, reason
from ellipseg_ros.poses.series import PoseSample
from ellipseg_ros.poses.transforms import Transform, from_matrix, transform
from ellipseg_ros.records import SECOND, Array

FIXED_FRAME = "odom"  # of files, which name none


def read_pose_file(path: Path, stamps_ns: list[int]) -> list[PoseSample]:
    """Poses of the sensor, in the order of the file.

    TUM: lines of `time x y z qx qy qz qw`, s and m. KITTI: lines of 12 numbers, the rows of a
    (3, 4) matrix; line k is the pose at the k-th of stamps_ns, those of the clouds.
    Raises InputError, with the line, if the file has another form.
    """
    try:
        table = np.loadtxt(path, ndmin=2)
    except (OSError, ValueError) as error:
        problem = f"{path} can't be read as poses ({reason(error)})"
        raise InputError(f"{problem}; lines must have 8 (TUM) or 12 numbers (KITTI)") from error
    if table.shape[1] == 8:
        return [_tum_pose(row) for row in table]
    if table.shape[1] != 12:
        problem = f"the lines of {path} have {table.shape[1]} numbers"
        raise InputError(f"{problem}; they must have 8 (TUM) or 12 (KITTI)")
    if len(table) != len(stamps_ns):
        problem = f"{path} has {len(table)} poses for {len(stamps_ns)} clouds"
        raise InputError(f"{problem}; in the form of KITTI there must be one for each")
    poses = table.reshape(-1, 3, 4)
    return [_sample(t, from_matrix(pose)) for t, pose in zip(stamps_ns, poses, strict=True)]


def _tum_pose(row: Array) -> PoseSample:
    seconds, *numbers = row.tolist()
    return _sample(round(seconds * SECOND), transform(numbers[:3], numbers[3:]))


def _sample(time_ns: int, pose: Transform) -> PoseSample:
    return PoseSample(time_ns, FIXED_FRAME, "", pose)
