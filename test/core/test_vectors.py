"""Vectors of three components, against numpy."""

import numpy as np
import pytest

from ellipseg_ros.core.linalg import vectors

pytestmark = pytest.mark.nojit


def test_vector_operations_equal_numpy():
    a, b = np.random.default_rng(0).normal(size=(2, 3))
    assert vectors.dot(a, b) == pytest.approx(np.dot(a, b))
    assert vectors.norm(a) == pytest.approx(np.linalg.norm(a))
    assert vectors.cross(a, b) == pytest.approx(np.cross(a, b))
    assert vectors.difference(a, b) == pytest.approx(a - b)
    assert vectors.combined(a, 3.0, b) == pytest.approx(a + 3.0 * b)


def test_rows_and_columns_equal_numpy():
    matrix = np.arange(9.0).reshape(3, 3)
    assert vectors.row(matrix, 1) == tuple(matrix[1])
    assert vectors.column(matrix, 2) == tuple(matrix[:, 2])
