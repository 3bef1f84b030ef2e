"""Rigid transforms as position and unit quaternion, in the convention of geometry_msgs."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ellipseg_ros.config import MAX_NORM_ERROR
from ellipseg_ros.errors import InputError
from ellipseg_ros.records import Array

MAX_POSITION_M = 1e8  # beyond is no measurement, as for points
ROUNDING = 1e-15  # of the norm of a quaternion that has been normalized


class Transform(NamedTuple):
    """p_parent = rotation p_child + position."""

    position: Array  # (3,) float64, m
    rotation: Array  # (4,) float64, unit quaternion x, y, z, w

    @property
    def matrix(self) -> Array:
        """(4, 4) float64: p_parent = matrix p_child."""
        matrix = np.eye(4)
        matrix[:3, :3] = Rotation.from_quat(self.rotation).as_matrix()
        matrix[:3, 3] = self.position
        return matrix


IDENTITY = Transform(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]))


def transform(position: Sequence[float], rotation: Sequence[float]) -> Transform:
    """A checked transform; rotation: quaternion x, y, z, w, which is normalized.

    A transform that was checked before, written and read again stays the same.
    Raises InputError for numbers that are not finite, and quaternions of another norm than 1.
    """
    moved, turned = np.array(position, float), np.array(rotation, float)
    if not (np.isfinite(turned).all() and (np.abs(moved) <= MAX_POSITION_M).all()):
        numbers = ", ".join(f"{x:g}" for x in (*position, *rotation))
        problem = f"a pose is {numbers}; its numbers must be finite"
        raise InputError(f"{problem}, and positions at most {MAX_POSITION_M:g} m", "pose_numbers")
    norm = math.sqrt(float(turned @ turned))
    if abs(norm - 1.0) > MAX_NORM_ERROR:
        raise InputError(f"a quaternion has norm {norm:g}; it must have norm 1", "quaternion")
    return Transform(moved, turned if abs(norm - 1.0) <= ROUNDING else turned / norm)


def from_matrix(matrix: Array) -> Transform:
    """(4, 4) or (3, 4), p_parent = matrix p_child; InputError unless it is a rigid motion."""
    turn = np.asarray(matrix, float)[:3, :3]
    rigid = np.isfinite(matrix).all() and np.allclose(turn @ turn.T, np.eye(3), atol=0.01)
    if not rigid or np.linalg.det(turn) < 0.0:
        problem = "the left 3 x 3 part of a pose is no rotation"
        raise InputError(f"{problem}; it must be orthonormal, with determinant 1", "rotation")
    return transform(np.asarray(matrix)[:3, 3], Rotation.from_matrix(turn).as_quat())


def compose(outer: Transform, inner: Transform) -> Transform:
    """The transform that applies `inner` first."""
    turn = Rotation.from_quat(outer.rotation)
    rotation = (turn * Rotation.from_quat(inner.rotation)).as_quat()
    return Transform(outer.position + turn.apply(inner.position), rotation)


def inverse(of: Transform) -> Transform:
    """The transform in the other direction."""
    turn = Rotation.from_quat(of.rotation).inv()
    return Transform(-turn.apply(of.position), turn.as_quat())
