"""Trajectories from text files, in the forms of TUM and of KITTI."""

from collections.abc import Iterable
from decimal import Decimal
from pathlib import Path

import numpy as np

from ellipseg_ros.errors import InputError, reason
from ellipseg_ros.io.limits import MAX_STAMP_S
from ellipseg_ros.poses.series import PoseSample
from ellipseg_ros.poses.transforms import Transform, from_matrix, transform
from ellipseg_ros.records import SECOND

FIXED_FRAME = "odom"  # of files, which name none
FORMS = "lines must have 8 (TUM) or 12 numbers (KITTI)"


def read_pose_file(path: Path, stamps_ns: Iterable[int]) -> list[PoseSample]:
    """Poses of the sensor, in the order of the file.

    TUM: lines of `time x y z qx qy qz qw`, s and m. KITTI: lines of 12 numbers, the rows of a
    (3, 4) matrix; line k is the pose at the k-th of stamps_ns, those of the clouds, which are
    iterated for this form only.
    Raises InputError, which names the file and the pose, if the file has another form.
    """
    lines = _lines(path)
    is_tum = len(lines[0]) == 8
    stamps = [] if is_tum else list(stamps_ns)
    if not is_tum and len(lines) != len(stamps):
        problem = f"{path} has {len(lines)} poses for {len(stamps)} clouds"
        raise InputError(f"{problem}; in the form of KITTI there must be one for each")
    samples = []
    for row, line in enumerate(lines):
        try:
            time_ns = _nanoseconds(line[0]) if is_tum else stamps[row]
            samples.append(PoseSample(time_ns, FIXED_FRAME, "", _pose(line)))
        except InputError as error:
            raise InputError(f"pose {row + 1} of {path}: {error}", error.reason) from error
    return samples


def _lines(path: Path) -> list[list[str]]:
    """The words of all lines but comments: 8 or 12 numbers in each."""
    try:
        words = [line.split() for line in path.read_text(encoding="utf-8").splitlines()]
        lines = [line for line in words if line and not line[0].startswith("#")]
        columns = np.array(lines, float).shape[1:]
    except (OSError, ValueError) as error:
        raise InputError(f"{path} can't be read as poses ({reason(error)}); {FORMS}") from error
    if columns not in ((8,), (12,)):
        number = f"{columns[0]} numbers in a line" if columns else "no poses"
        raise InputError(f"{path} has {number}; {FORMS}")
    return lines


def _nanoseconds(seconds: str) -> int:
    """Exact, as poses and clouds of the same time must have the same ns."""
    time = Decimal(seconds)
    if not (time.is_finite() and abs(time) <= MAX_STAMP_S):
        raise InputError(f"its time is {seconds} s; it must be at most {MAX_STAMP_S} s", "stamp")
    return round(time * SECOND)


def _pose(line: list[str]) -> Transform:
    numbers = np.array(line, float)
    if len(line) == 8:
        return transform(numbers[1:4], numbers[4:])
    return from_matrix(numbers.reshape(3, 4))
