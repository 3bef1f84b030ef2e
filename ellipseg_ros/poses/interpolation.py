"""Poses between samples, and points moved by the pose at their own time.

Positions are interpolated linearly, rotations by spherical linear interpolation (Shoemake,
"Animating rotation with quaternion curves", SIGGRAPH 1985).
"""

import math

import numpy as np

from ellipseg_ros.core.jit import kernel
from ellipseg_ros.poses.series import POSE
from ellipseg_ros.poses.transforms import Transform
from ellipseg_ros.records import Array

SMALL_ANGLE = 1e-7  # rad, below which sin(x) = x in float64


def interpolated(poses: Array, times_ns: Array) -> Array:
    """Poses at given times: (p,) of POSE, ascending; (m,) int64 within them -> (m,) of POSE."""
    result = np.zeros(len(times_ns), POSE)
    result["time_ns"] = times_ns
    result["run"] = poses["run"][0]
    _interpolate(poses, times_ns, result)
    return result


def place(points: Array, times_ns: Array, poses: Array, extrinsic: Transform) -> Array:
    """Points in the fixed frame: each moved by the pose at its own time.

    points (n, 3) float64, m, sensor frame; times_ns (n,) int64; poses (p,) of POSE, of the frame
    that the extrinsic leads to, and at or around all times. NaN stays NaN. -> (n, 3) m.
    """
    turned = np.empty_like(points)
    _turn(points, extrinsic.rotation, extrinsic.position, turned)
    placed = np.empty_like(points)
    _place(turned, times_ns, poses, placed)
    return placed


@kernel
def _interpolate(poses, times_ns, result):
    row = 0
    rotation = np.empty(4)
    for i in range(len(times_ns)):
        row = _interval(poses, times_ns[i], row)
        share = _share(poses, row, times_ns[i])
        _slerp(poses, row, share, rotation)
        for axis in range(3):
            result[i]["position"][axis] = _between(poses, row, share, axis)
        for axis in range(4):
            result[i]["rotation"][axis] = rotation[axis]


@kernel
def _place(points, times_ns, poses, placed):
    row = 0
    rotation, position = np.empty(4), np.empty(3)
    for i in range(len(points)):
        time_ns = times_ns[i]
        if i == 0 or time_ns != times_ns[i - 1]:
            row = _interval(poses, time_ns, row)
            share = _share(poses, row, time_ns)
            _slerp(poses, row, share, rotation)
            for axis in range(3):
                position[axis] = _between(poses, row, share, axis)
        x, y, z = _rotated(rotation, points[i, 0], points[i, 1], points[i, 2])
        placed[i, 0] = x + position[0]
        placed[i, 1] = y + position[1]
        placed[i, 2] = z + position[2]


@kernel
def _turn(points, rotation, position, result):
    for i in range(len(points)):
        x, y, z = _rotated(rotation, points[i, 0], points[i, 1], points[i, 2])
        result[i, 0] = x + position[0]
        result[i, 1] = y + position[1]
        result[i, 2] = z + position[2]


@kernel
def _interval(poses, time_ns, row):
    """Row of the last pose before the last one at or before the time; row: where to look first."""
    last = max(len(poses) - 2, 0)
    row = min(row, last)
    while row < last and poses[row + 1]["time_ns"] <= time_ns:
        row += 1
    while row > 0 and poses[row]["time_ns"] > time_ns:
        row -= 1
    return row


@kernel
def _share(poses, row, time_ns):
    """Share of the interval after `row` that has passed, 0 to 1: exactly, at its poses."""
    if len(poses) == 1:
        return 0.0
    start = poses[row]["time_ns"]
    share = (time_ns - start) / (poses[row + 1]["time_ns"] - start)
    return min(max(share, 0.0), 1.0)


@kernel
def _between(poses, row, share, axis):
    if share == 0.0 or share == 1.0:
        return poses[row + int(share)]["position"][axis]
    start = poses[row]["position"][axis]
    return start + share * (poses[row + 1]["position"][axis] - start)


@kernel
def _slerp(poses, row, share, rotation):
    if share == 0.0 or share == 1.0:
        for axis in range(4):
            rotation[axis] = poses[row + int(share)]["rotation"][axis]
        return
    start, end = poses[row]["rotation"], poses[row + 1]["rotation"]
    dot = 0.0
    for axis in range(4):
        dot += start[axis] * end[axis]
    sign = 1.0 if dot >= 0.0 else -1.0  # the shorter way round
    angle = math.acos(min(abs(dot), 1.0))
    weight_start, weight_end = 1.0 - share, share
    if angle > SMALL_ANGLE:
        sine = math.sin(angle)
        weight_start = math.sin((1.0 - share) * angle) / sine
        weight_end = math.sin(share * angle) / sine
    norm = 0.0
    for axis in range(4):
        rotation[axis] = weight_start * start[axis] + sign * weight_end * end[axis]
        norm += rotation[axis] ** 2
    norm = math.sqrt(norm)
    for axis in range(4):
        rotation[axis] /= norm


@kernel
def _rotated(q, x, y, z):
    """A vector turned by a unit quaternion x, y, z, w."""
    cross_x = 2.0 * (q[1] * z - q[2] * y)
    cross_y = 2.0 * (q[2] * x - q[0] * z)
    cross_z = 2.0 * (q[0] * y - q[1] * x)
    turned_x = x + q[3] * cross_x + q[1] * cross_z - q[2] * cross_y
    turned_y = y + q[3] * cross_y + q[2] * cross_x - q[0] * cross_z
    turned_z = z + q[3] * cross_z + q[0] * cross_y - q[1] * cross_x
    return turned_x, turned_y, turned_z
