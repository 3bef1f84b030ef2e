"""Detection of planes, lines and blobs."""

import math
from dataclasses import replace

import numpy as np
import pytest
from landmark_scenes import NOISE, ball, landmarks_of, trunk, wall
from scipy.spatial.transform import Rotation

from ellipseg_ros.config import Config, LandmarksConfig, ObjectsConfig
from ellipseg_ros.errors import InputError
from ellipseg_ros.landmarks.of_segmentation import landmarks
from ellipseg_ros.records import Kind
from ellipseg_ros.segmenter import segment
from studies.landmarks.agreement import agreeing_pairs, transformed


def test_a_wall_in_tiles_is_one_plane_with_the_right_normal():
    rng = np.random.default_rng(1)
    points = wall(rng)
    coarse = segment(points, Config(threshold=1.0))
    assert len(coarse.ellipsoids) > 3  # tiles
    found = coarse.landmarks
    assert list(found.kind) == [Kind.PLANE]
    assert abs(found.axes[0, :, 2] @ [1.0, 0.0, 0.0]) > math.cos(math.radians(0.2))
    assert found.position[0, 0] == pytest.approx(3.0, abs=0.003)
    size = found.box_max[0] - found.box_min[0]
    assert size[:2] == pytest.approx([6.0, 2.5], abs=0.15)


def test_perpendicular_walls_are_two_planes():
    rng = np.random.default_rng(2)
    other = wall(rng)[:, [1, 0, 2]] + [3.0, -3.0, 0.0]
    found = landmarks_of(wall(rng), other)
    assert sorted(found.kind) == [Kind.PLANE, Kind.PLANE]
    assert abs(found.axes[0, :, 2] @ found.axes[1, :, 2]) < 0.02


@pytest.mark.parametrize("lean", [0.0, 0.15])
def test_a_half_visible_trunk_is_one_line_on_its_axis(lean):
    found = landmarks_of(trunk(np.random.default_rng(3), lean=lean))
    assert list(found.kind) == [Kind.LINE]
    axis = found.axes[0, :, 0]
    truth = np.array([0.0, math.sin(lean), math.cos(lean)])
    assert abs(axis @ truth) > math.cos(math.radians(0.5))
    aside = found.position[0] - (found.position[0] @ axis) * axis
    assert np.linalg.norm(aside) < 0.02  # the mean of the points is 0.1 m off
    assert found.box_max[0, 0] - found.box_min[0, 0] == pytest.approx(4.0, abs=0.3)


def test_a_small_isolated_bush_is_a_blob():
    rng = np.random.default_rng(4)
    found = landmarks_of(ball(rng), ball(rng, size=1.0, n=5000, at=(20.0, 0.0, 3.0)))
    assert list(found.kind) == [Kind.BLOB]
    assert found.position[0] == pytest.approx([0.0, 0.0, 1.0], abs=0.03)


def test_undulating_ground_is_no_plane():
    rng = np.random.default_rng(5)
    x, y = rng.uniform(-4.0, 4.0, (2, 6000))
    z = 0.3 * np.sin(2.0 * x) * np.cos(2.0 * y) + rng.normal(0.0, NOISE, 6000)
    assert not len(np.flatnonzero(landmarks_of(np.column_stack([x, y, z])).kind == Kind.PLANE))


def test_a_single_scan_line_is_no_line():
    rng = np.random.default_rng(6)
    y = np.linspace(0.0, 6.0, 200)
    sweep = np.column_stack([np.full(200, 3.0), y, np.full(200, 1.0)])
    sweep += rng.normal(0.0, NOISE, sweep.shape)
    assert not len(segment(sweep).landmarks)
    assert not len(segment(np.vstack([sweep, sweep + [0.0, 0.02, 0.01]])).landmarks)


def test_few_or_no_points_give_no_landmark():
    rng = np.random.default_rng(7)
    assert not len(landmarks_of(wall(rng, n=30)))
    for points in (np.zeros((0, 3)), np.zeros((50, 3)), np.full((5, 3), np.nan)):
        assert not len(segment(points).landmarks)


def test_point_labels_and_segments_are_those_of_the_landmarks():
    rng = np.random.default_rng(8)
    points = np.vstack([wall(rng), trunk(rng, foot=(-3.0, 0.0, 0.0))])
    found = segment(points)
    marks = found.landmarks
    assert list(np.bincount(marks.point_labels + 1)[1:]) == list(marks.count)
    for row in range(len(marks)):
        assert set(marks.segments[row]) == set(found.labels[marks.point_labels == row])
    assert (np.diff(marks.ids.astype(int)) > 0).all()


def test_disabled_landmarks_can_be_detected_afterwards():
    points = wall(np.random.default_rng(9))
    off = Config(landmarks=LandmarksConfig(enabled=False))
    found = segment(points, off)
    assert found.landmarks is None
    assert len(landmarks(found)) == 1  # but they can be had
    nothing = replace(off, objects=ObjectsConfig(enabled=False))
    with pytest.raises(InputError, match="adjacency"):
        landmarks(segment(points, nothing))


def test_landmarks_of_a_segmentation_equal_those_of_the_segmenter():
    rng = np.random.default_rng(10)
    found = segment(np.vstack([wall(rng), trunk(rng, foot=(-3.0, 0.0, 0.0))]) + [4e5, 5e6, 100.0])
    again = landmarks(found)
    for name in ("kind", "count", "position", "axes", "covariance", "point_labels"):
        assert np.array_equal(getattr(found.landmarks, name), getattr(again, name)), name


def test_landmarks_move_with_the_scene():
    rng = np.random.default_rng(11)
    points = np.vstack([wall(rng), trunk(rng, foot=(-3.0, 0.0, 0.0))])
    points = points[rng.permutation(len(points))]
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_euler("xyz", [0.2, -0.3, 1.0]).as_matrix()
    turn[:3, 3] = [5.0, -2.0, 1.0]
    one = segment(points).landmarks
    other = segment(points @ turn[:3, :3].T + turn[:3, 3]).landmarks
    pairs = agreeing_pairs(transformed(one, turn), other)
    assert set(pairs.earlier) == set(range(len(one))) == set(pairs.later)
