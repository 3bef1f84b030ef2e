"""What a fit to points says, and how far it can be trusted."""

import math
from typing import NamedTuple

import numpy as np

from ellipseg_ros.core.jit import kernel
from ellipseg_ros.records import Array

CHUNKS = 16  # parts of a thing's points, in order of arrival, whose errors may be of one piece
APART = 3  # rows between two points from which on they are of two passages of the beam


class Fits(NamedTuple):
    """Shapes fitted to the points of c things; frame, axes and motions as in `Landmarks`."""

    count: Array  # (c,) int64, points
    passages: Array  # (c,) int64: how often the beam has passed over it
    position: Array  # (c, 3) m, local origin
    axes: Array  # (c, 3, 3)
    sigma: Array  # (c, 3) m
    low: Array  # (c, 3) m
    high: Array  # (c, 3)
    covariance: Array  # (c, 6, 6) of motions
    roughness: Array  # (c,) m: standard deviation of the points from the shape


def no_fits(count: int) -> Fits:
    """Room for so many."""
    return Fits(
        count=np.zeros(count, np.int64),
        passages=np.zeros(count, np.int64),
        position=np.zeros((count, 3)),
        axes=np.tile(np.eye(3), (count, 1, 1)),
        sigma=np.zeros((count, 3)),
        low=np.zeros((count, 3)),
        high=np.zeros((count, 3)),
        covariance=np.zeros((count, 6, 6)),
        roughness=np.zeros(count),
    )


def joined(parts: list[Fits]) -> Fits:
    """Several lots below one another."""
    return Fits(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def chosen(fits: Fits, rows: Array) -> Fits:
    """Some rows, or those that a mask selects."""
    return Fits(*(column[rows] for column in fits))


@kernel
def passages(rows):
    """How many runs of consecutive points there are; rows ascend.

    A beam that sweeps over a thing leaves a run of points. A pole that was passed over fifty times
    is known from fifty places; the fifty points of one sweep along a far wall are one line drawn
    by the scanner, not one that is there.
    """
    found = 0
    for k in range(len(rows)):
        found += k == 0 or rows[k] - rows[k - 1] > APART
    return found


@kernel
def cholesky(matrix):
    """Factor a symmetric matrix (m, m) in place: its lower half becomes L with L L^T = A.

    Returns False if it is not positive definite.
    """
    for i in range(len(matrix)):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            if i > j:
                matrix[i, j] = total / matrix[j, j]
            elif total > 0.0:
                matrix[i, i] = math.sqrt(total)
            else:
                return False
    return True


@kernel
def solve(factor, right):
    """Solve L L^T x = b for the factor of `cholesky`; b (m,) becomes x."""
    size = len(right)
    for i in range(size):
        for k in range(i):
            right[i] -= factor[i, k] * right[k]
        right[i] /= factor[i, i]
    for i in range(size - 1, -1, -1):
        for k in range(i + 1, size):
            right[i] -= factor[k, i] * right[k]
        right[i] /= factor[i, i]


@kernel
def uncertainty(matrix, scores, variance):
    """Covariance (m, m) of a least-squares fit whose errors are not independent.

    matrix (m, m): normal equations, consumed; scores (CHUNKS, m): sums of Jacobian times residual
    over chunks of points; variance: of the residuals. It is the usual variance A^-1 times the
    design effect: by how much the scores vary more, from chunk to chunk, than those of
    independent errors would, at least 1 (Moulton 1986, Random group effects and the precision of
    regression estimates). Drift, curvature and whatever sticks out are in it that way.
    Returns a matrix of inf if there is no solution.
    """
    size = len(matrix)
    inverse = np.full((size, size), np.inf)
    if not (variance > 0.0 and cholesky(matrix)):
        return inverse
    effect = 0.0
    for chunk in range(len(scores)):
        solved = scores[chunk].copy()
        solve(matrix, solved)
        for m in range(size):
            effect += solved[m] * scores[chunk, m]
    effect = max(1.0, effect / (variance * size))
    for m in range(size):
        column = np.zeros(size)
        column[m] = variance * effect
        solve(matrix, column)
        inverse[:, m] = column
    return inverse
