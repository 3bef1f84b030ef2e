"""Residuals of pairs of landmarks against a plain twin and against finite motions."""

from dataclasses import replace

import naive
import numpy as np
import pytest
import worlds
from scipy.spatial.transform import Rotation

from ellipseg_ros.association.associate import pair_residual
from ellipseg_ros.association.candidates import add_normal_equations
from ellipseg_ros.association.constants import GATES
from ellipseg_ros.association.pairing import DEGREES, compare, mahalanobis, may_match, workspace
from ellipseg_ros.config import AssociationConfig
from ellipseg_ros.records import DETERMINED, Kind

pytestmark = pytest.mark.nojit
DIRECTION = {Kind.PLANE: 2, Kind.LINE: 0, Kind.BLOB: None}


def perturbed(found, row, motion, pivot):
    """A set, one row of which moves by (6,) about a pivot."""
    turn = Rotation.from_rotvec(motion[3:]).as_matrix()
    position, axes = found.position.copy(), found.axes.copy()
    position[row] = turn @ (position[row] - pivot) + pivot + motion[:3]
    axes[row] = turn @ axes[row]
    return replace(found, position=position, axes=axes)


def with_full_covariance(found, row, rng):
    """The set with correlated motions of one row."""
    determined = list(DETERMINED[Kind(found.kind[row])])
    root = rng.normal(size=(len(determined), len(determined))) * 0.05
    covariance = np.zeros((len(found), 6, 6))
    covariance[row][np.ix_(determined, determined)] = root @ root.T
    return replace(found, covariance=covariance)


def naive_residual(one, other, row):
    """Residual and covariance of one row of two sets of arrays."""
    kind = Kind(one.kind[row])
    parts = [(each.position[row], each.axes[row], each.covariance[row]) for each in (one, other)]
    return naive.landmark_residual(DIRECTION[kind], DETERMINED[kind], *parts)


@pytest.mark.parametrize("row", range(3))
@pytest.mark.parametrize("seed", range(3))
def test_residual_and_covariance_equal_the_plain_twin(row, seed):
    rng = np.random.default_rng([seed, row])
    sets = [with_full_covariance(one, row, rng) for one in worlds.one_of_each_kind(rng)]
    one, other = (worlds.arrays(each) for each in sets)
    work = workspace()
    d = compare(one, other, row, row, np.eye(4), np.zeros(3), work)
    residual, covariance = naive_residual(one, other, row)
    np.testing.assert_allclose(work.residual[:d], residual, atol=1e-12)
    np.testing.assert_allclose(work.covariance[:d, :d], covariance, atol=1e-15)


@pytest.mark.parametrize("row", range(3))
def test_jacobian_is_the_derivative_and_exact_half_way(row):
    rng = np.random.default_rng(row)
    one, _ = worlds.one_of_each_kind(rng)
    pivot, work = rng.normal(size=3), workspace()
    for size in (1e-4, 0.15):  # rad; and m
        motion = size * rng.normal(size=6) / 3.0
        other = worlds.arrays(perturbed(one, row, motion, pivot))
        d = compare(worlds.arrays(one), other, row, row, np.eye(4), pivot, work)
        assert d == DEGREES[one.kind[row]] == len(DETERMINED[Kind(one.kind[row])])
        np.testing.assert_allclose(
            work.residual[:d], work.jacobian[:d] @ motion, atol=2.0 * size**2
        )


@pytest.mark.parametrize("row", range(3))
def test_mahalanobis_distance_equals_numpy(row):
    rng = np.random.default_rng(10 + row)
    one, other = (worlds.arrays(each) for each in worlds.one_of_each_kind(rng))
    work, uncertainty = workspace(), np.diag(rng.uniform(0.001, 0.01, 6))
    d = compare(one, other, row, row, np.eye(4), np.zeros(3), work)
    residual, covariance = naive_residual(one, other, row)
    jacobian = work.jacobian[:d].copy()
    total = covariance + jacobian @ uncertainty @ jacobian.T
    square, log_determinant = mahalanobis(work, d, uncertainty)
    assert square == pytest.approx(residual @ np.linalg.solve(total, residual))
    assert log_determinant == pytest.approx(np.linalg.slogdet(total)[1])


def test_pairs_within_the_gate_always_may_match():
    rng = np.random.default_rng(20)
    work, within = workspace(), 0
    for _ in range(200):
        one, other = (worlds.arrays(each) for each in worlds.one_of_each_kind(rng))
        transform = worlds.drift(rng, 0.05, 0.3, np.zeros(3))
        for row in range(3):
            d = compare(one, other, row, row, transform, np.zeros(3), work)
            square, _ = mahalanobis(work, d, np.zeros((6, 6)))
            if square <= GATES[one.kind[row]]:
                within += 1
                assert may_match(one, other, row, row, transform, (0.0, 0.0, 0.5))
    assert within > 50


def test_normal_equations_of_a_pair_equal_numpy():
    rng = np.random.default_rng(50)
    one, other = (worlds.arrays(found) for found in worlds.one_of_each_kind(rng))
    for row in range(3):
        work, matrix, vector = workspace(), np.zeros((6, 6)), np.zeros(6)
        d = compare(one, other, row, row, np.eye(4), np.zeros(3), work)
        j, r = work.jacobian[:d].copy(), work.residual[:d].copy()
        weight = np.linalg.inv(work.covariance[:d, :d].copy())
        square = add_normal_equations(work, d, matrix, vector)
        np.testing.assert_allclose(matrix, j.T @ weight @ j, atol=1e-6 * np.abs(matrix).max())
        np.testing.assert_allclose(vector, -j.T @ weight @ r, atol=1e-6 * np.abs(vector).max())
        assert square == pytest.approx(r @ weight @ r)


@pytest.mark.parametrize("row", range(3))
def test_public_residual_is_that_of_the_transformed_landmark(row):
    rng = np.random.default_rng(30 + row)
    earlier, later = worlds.one_of_each_kind(rng)
    transform = worlds.drift(rng, 0.3, 2.0, later.position[row])
    config = AssociationConfig(noise=0.02, angle_noise=0.2)
    found = pair_residual(earlier, later, (row, row), transform, config)
    one, other = worlds.arrays(earlier), worlds.arrays(worlds.moved(later, transform))
    residual, covariance = naive_residual(one, other, row)
    np.testing.assert_allclose(found.residual, residual, atol=1e-12)
    np.testing.assert_allclose(found.covariance, covariance, atol=1e-15)
