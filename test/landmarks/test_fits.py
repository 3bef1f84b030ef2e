"""Kernels that fit shapes, against plain or scipy oracles."""

import math

import numpy as np
import pytest
from landmark_scenes import NOISE, trunk

from ellipseg_ros.core.members import group_boxes, group_members, groups_of_points
from ellipseg_ros.landmarks import fits
from ellipseg_ros.landmarks.cylinder import PARAMETERS, across, axial, fit_cylinder


@pytest.mark.nojit
def test_members_and_boxes_equal_a_plain_loop():
    rng = np.random.default_rng(16)
    points, labels = rng.normal(size=(200, 3)), rng.integers(-2, 9, 200).astype(np.int32)
    group = np.array([0, 1, 1, -1, 2, 0, 2, 2, 1], np.int32)
    of_point = groups_of_points(labels, group)
    found, around = group_members(of_point, 3), group_boxes(points, of_point, 3)
    for g in range(3):
        rows = [i for i in range(200) if labels[i] >= 0 and group[labels[i]] == g]
        assert list(found.rows[found.starts[g] : found.starts[g + 1]]) == rows
        assert np.array_equal(around.low[g], points[rows].min(axis=0))
        assert np.array_equal(around.high[g], points[rows].max(axis=0))


@pytest.mark.nojit
def test_passes_are_runs_of_consecutive_points():
    assert fits.count_passes(np.array([0, 1, 2, 10, 12, 13, 99])) == 3
    assert fits.count_passes(np.zeros(0, np.int64)) == 0


@pytest.mark.nojit
def test_cylinder_fit_equals_scipy_least_squares():
    optimize = pytest.importorskip("scipy.optimize")
    points = trunk(np.random.default_rng(18), n=60, radius=0.2)
    point, axis = np.array([-0.1, 0.02, 2.0]), np.array([0.0, 0.02, 1.0])
    axis /= np.linalg.norm(axis)
    u, v = across(axis)
    assert np.allclose(np.linalg.det(np.column_stack([axis, u, v])), 1.0)
    fit = np.zeros(PARAMETERS)
    fit[4] = 0.15
    spread = fit_cylinder(points, np.arange(len(points)), point, axis, fit)

    def distances(x):
        offset = points - point
        along = offset @ axis
        a, b = offset @ u - x[0] - x[2] * along, offset @ v - x[1] - x[3] * along
        return np.hypot(a, b) - x[4] - x[5] * along

    best = optimize.least_squares(distances, fit).x
    assert spread == pytest.approx(NOISE, rel=0.4)
    assert np.abs(best[:2] - fit[:2]).max() < 0.02 and abs(best[4] - fit[4]) < 0.03
    along, aside = axial(points, 0, point, axis)
    assert math.hypot(along, aside) == pytest.approx(np.linalg.norm(points[0] - point))
