"""Checking and conversion of LandmarkArray messages, of rclpy or rosbags."""

from operator import attrgetter
from typing import Any

import numpy as np

from ellipseg_ros.association.landmark_map import check_landmarks
from ellipseg_ros.errors import InputError
from ellipseg_ros.io.limits import nanoseconds
from ellipseg_ros.records import Array, Landmarks

MAX_LANDMARKS = 5000  # of a message; a window has hundreds, each compared with the whole map


def read_landmarks(message: Any) -> Landmarks:
    """Convert a message to Landmarks in ascending order of id.

    Raises InputError, in one line, for an invalid message: unknown kinds, duplicate ids, numbers
    that are not finite, orientations that are not of length 1, too many landmarks.
    """
    if len(message.landmarks) > MAX_LANDMARKS:
        problem = f"there are {len(message.landmarks)} landmarks"
        raise InputError(f"{problem}; at most {MAX_LANDMARKS} are allowed", "many")
    xyz, xyzw = attrgetter("x", "y", "z"), attrgetter("x", "y", "z", "w")
    rows = sorted(message.landmarks, key=attrgetter("id"))
    orientation = _table([xyzw(row.orientation) for row in rows], 4)
    with np.errstate(over="ignore"):
        length = np.sqrt((orientation**2).sum(axis=1))
    if not (np.abs(length - 1.0) < 1e-3).all():
        raise InputError("a landmark's orientation is not of length 1", "orientation")
    landmarks = Landmarks(
        ids=np.array([row.id for row in rows], np.uint32),
        kind=np.array([row.kind for row in rows], np.uint8),
        count=np.array([row.count for row in rows], np.int64),
        position=_table([xyz(row.position) for row in rows], 3),
        axes=rotations(orientation / length[:, None]),
        sigma=_table([row.sigma for row in rows], 3),
        box_min=_table([xyz(row.box_min) for row in rows], 3),
        box_max=_table([xyz(row.box_max) for row in rows], 3),
        covariance=_table([row.covariance for row in rows], 36).reshape(-1, 6, 6),
        instability=np.array([row.instability for row in rows], np.float64),
        first_seen_ns=np.array([nanoseconds(row.first_seen) for row in rows], np.int64),
    )
    if (np.diff(landmarks.ids.astype(np.int64)) == 0).any():
        raise InputError("a landmark's id occurs twice", "ids")
    check_landmarks(landmarks)
    return landmarks


def rotations(quaternions: Array) -> Array:
    """(n, 4) unit quaternions x, y, z, w -> (n, 3, 3) rotation matrices."""
    x, y, z, w = quaternions.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.ascontiguousarray(np.moveaxis(np.array(rows), 2, 0))


def _table(rows: list[Any], width: int) -> Array:
    if any(len(row) != width for row in rows):
        raise InputError(f"a landmark has a row that is not of {width} numbers", "length")
    return np.array(rows, np.float64).reshape(len(rows), width)
