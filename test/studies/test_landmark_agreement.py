"""Agreement of landmarks of two passes."""

import numpy as np
import pytest
from landmark_scenes import ball, landmarks_of, trunk, wall
from scipy.spatial.transform import Rotation

from ellipseg_ros.records import Kind
from studies.landmarks.agreement import agreeing_pairs, transformed
from studies.landmarks.passes import rigid_transform
from studies.landmarks.repeatability import normalised_errors


def test_rigid_motion_of_points_is_recovered():
    rng = np.random.default_rng(19)
    points, turn = rng.normal(size=(50, 3)), Rotation.random(random_state=1).as_matrix()
    motion = rigid_transform(points, points @ turn.T + [1.0, 2.0, 3.0])
    assert np.allclose(motion[:3, :3], turn) and np.allclose(motion[:3, 3], [1.0, 2.0, 3.0])


def test_agreement_regards_only_determined_motions():
    rng = np.random.default_rng(20)
    here = landmarks_of(
        wall(rng), trunk(rng, foot=(-3.0, 0.0, 0.0)), ball(rng, at=(-6.0, 5.0, 0.0))
    )
    assert sorted(here.kind) == [Kind.PLANE, Kind.LINE, Kind.BLOB]

    def agree(shift):
        motion = np.eye(4)
        motion[:3, 3] = shift
        return {
            int(here.kind[row]) for row in agreeing_pairs(here, transformed(here, motion)).earlier
        }

    assert agree([0.0, 0.0, 0.0]) == {Kind.PLANE, Kind.LINE, Kind.BLOB}
    assert agree([0.0, 0.0, 1.0]) == {Kind.PLANE, Kind.LINE}  # along both
    assert agree([0.0, 1.0, 0.0]) == {Kind.PLANE}
    assert agree([0.08, 0.0, 0.0]) == {Kind.LINE, Kind.BLOB}
    assert agree([0.0, 20.0, 0.0]) == set()  # beside the wall


def test_normalised_errors_of_equal_landmarks_are_zero():
    here = landmarks_of(wall(np.random.default_rng(21)))
    errors = normalised_errors(here, here, np.eye(4))
    assert errors["plane"] == [pytest.approx(0.0, abs=1e-6)]
