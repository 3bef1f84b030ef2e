"""Interpolation of one pose by scipy."""

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

NS = 10**9


def naive_pose(poses, time_ns):
    """Position (3,) and scipy Rotation at one time."""
    if len(poses) == 1:
        return poses["position"][0], Rotation.from_quat(poses["rotation"][0])
    seconds = (poses["time_ns"] - poses["time_ns"][0]) / NS
    at = (int(time_ns) - int(poses["time_ns"][0])) / NS
    position = [np.interp(at, seconds, poses["position"][:, axis]) for axis in range(3)]
    return np.array(position), Slerp(seconds, Rotation.from_quat(poses["rotation"]))(at)
