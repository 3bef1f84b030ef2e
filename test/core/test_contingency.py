"""Contingency tables, connected components and Cholesky factors against plain or scipy oracles."""

import naive
import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ellipseg_ros.core.contingency import contingency
from ellipseg_ros.core.disjoint_set import components
from ellipseg_ros.core.linalg.cholesky import factorize, log_determinant, solve

pytestmark = pytest.mark.nojit


@pytest.mark.parametrize(("items", "rows", "columns"), [(0, 0, 0), (1, 1, 1), (300, 7, 40)])
def test_contingency_equals_counting_pairs(items, rows, columns):
    rng = np.random.default_rng(items)
    first, second = (rng.integers(-1, size, items).astype(np.int32) for size in (rows, columns))
    table = contingency(first, second, (rows, columns))
    expected = naive.contingency(first.tolist(), second.tolist())
    entries = list(zip(table.rows.tolist(), table.columns.tolist(), strict=True))
    assert entries == sorted(expected)
    assert table.counts.tolist() == [expected[entry] for entry in entries]


@pytest.mark.parametrize("edges", [0, 10, 40])
def test_components_equal_those_of_scipy(edges):
    rng = np.random.default_rng(edges)
    a, b = rng.integers(0, 30, (2, edges))
    found = components(30, a, b)
    graph = coo_array((np.ones(edges), (a, b)), shape=(30, 30))
    _, expected = connected_components(graph, directed=False)
    lowest = [np.flatnonzero(expected == label)[0] for label in expected]
    assert found.tolist() == lowest


def test_cholesky_solves_like_numpy():
    rng = np.random.default_rng(17)
    half = rng.normal(size=(5, 5))
    matrix, right = half @ half.T + np.eye(5), rng.normal(size=5)
    factor, solution = matrix.copy(), right.copy()
    assert factorize(factor, 5)
    solve(factor, 5, solution)
    np.testing.assert_allclose(solution, np.linalg.solve(matrix, right))
    assert log_determinant(factor, 5) == pytest.approx(np.linalg.slogdet(matrix)[1])


@pytest.mark.parametrize(
    "matrix", [[[1.0, 2.0], [2.0, 1.0]], np.zeros((2, 2)), [[np.nan] * 2] * 2]
)
def test_cholesky_rejects_matrices_that_are_not_positive_definite(matrix):
    factor = np.array(matrix)
    assert not factorize(factor, 2)
    assert np.isnan(factor).all()
