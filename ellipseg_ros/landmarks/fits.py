"""Shapes fitted to points, and the covariance of such fits."""

from typing import NamedTuple

import numpy as np

from ellipseg_ros.core.jit import inlined, kernel
from ellipseg_ros.core.linalg.cholesky import factorize, solve
from ellipseg_ros.records import Array

CHUNKS = 16  # parts of the points, in order of arrival, within which errors may be correlated
PASS_GAP = 3  # rows: points farther apart belong to different passes of the beam


class Fits(NamedTuple):
    """Shapes fitted to the points of c things; axes and motions as in `Landmarks`."""

    count: Array  # (c,) int64, points
    passes: Array  # (c,) int64, see `count_passes`
    position: Array  # (c, 3) m, local origin
    axes: Array  # (c, 3, 3)
    sigma: Array  # (c, 3) m
    box_min: Array  # (c, 3) m
    box_max: Array  # (c, 3)
    covariance: Array  # (c, 6, 6) of motions
    roughness: Array  # (c,) m: standard deviation of the points from the shape

    @classmethod
    def empty(cls, count: int) -> "Fits":
        """Fits to be filled in."""
        return cls(
            count=np.zeros(count, np.int64),
            passes=np.zeros(count, np.int64),
            position=np.zeros((count, 3)),
            axes=np.tile(np.eye(3), (count, 1, 1)),
            sigma=np.zeros((count, 3)),
            box_min=np.full((count, 3), np.inf),
            box_max=np.full((count, 3), -np.inf),
            covariance=np.zeros((count, 6, 6)),
            roughness=np.zeros(count),
        )

    def select(self, rows: Array) -> "Fits":
        """The given rows, or those that a mask selects."""
        return Fits(*(column[rows] for column in self))


def concatenate_fits(parts: list[Fits]) -> Fits:
    """The rows of all parts, in order."""
    return Fits(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def renumber(labels: Array, kept: Array) -> Array:
    """Labels (n,) int32 when only some things are kept (c,) bool: -1 for the points of others."""
    names = np.append(np.where(kept, np.cumsum(kept) - 1, -1), -1).astype(np.int32)
    return names[labels]


@kernel
def count_passes(rows):
    """Number of runs of consecutive points; rows ascend.

    A beam that sweeps over a thing leaves a run of points. A pole that was passed fifty times is
    known at fifty places; fifty points of one sweep along a far wall are one scan line.
    """
    return min(1, len(rows)) + np.count_nonzero(rows[1:] - rows[:-1] > PASS_GAP)


@kernel
def set_moments(moments, row, fits, which):
    """Set position, axes and sigma of a fit from a row of MOMENTS."""
    m = moments[row]
    fits.position[which] = m["mean"]
    fits.sigma[which] = np.sqrt(m.eigenvalues[::-1])
    fits.axes[which, :, 0], fits.axes[which, :, 1], fits.axes[which, :, 2] = m.v1, m.v2, m.v3


@inlined
def add_to_box(points, i, fits, which, local):
    """Write the coordinates of a point along the axes of a fit; extend the box of the fit."""
    for axis in range(3):
        local[axis] = 0.0
        for c in range(3):
            local[axis] += fits.axes[which, c, axis] * (points[i, c] - fits.position[which, c])
        fits.box_min[which, axis] = min(fits.box_min[which, axis], local[axis])
        fits.box_max[which, axis] = max(fits.box_max[which, axis], local[axis])


@inlined
def add_observation(jacobian, error, matrix, score):
    """Add J^T J to the lower half of the normal matrix, and J^T e to the score."""
    for m in range(len(jacobian)):
        score[m] += jacobian[m] * error
        for n in range(m + 1):
            matrix[m, n] += jacobian[m] * jacobian[n]


@kernel
def fit_covariance(matrix, scores, variance):
    """Covariance (m, m) of a least-squares fit whose errors are not independent.

    matrix (m, m): normal equations, overwritten; scores (CHUNKS, m): sums of Jacobian times
    residual over chunks of points; variance: of the residuals. It is the usual variance A^-1 times
    the design effect: by how much the scores vary more, from chunk to chunk, than those of
    independent errors would, at least 1 (Moulton 1986, Random group effects and the precision of
    regression estimates). That accounts for drift, curvature and protruding parts.
    Returns a matrix of inf if there is no solution.
    """
    size = len(matrix)
    inverse = np.full((size, size), np.inf)
    if not (variance > 0.0 and factorize(matrix, size)):
        return inverse
    effect = 0.0
    for chunk in range(len(scores)):
        solution = scores[chunk].copy()
        solve(matrix, size, solution)
        for m in range(size):
            effect += solution[m] * scores[chunk, m]
    effect = max(1.0, effect / (variance * size))
    for m in range(size):
        column = np.zeros(size)
        column[m] = variance * effect
        solve(matrix, size, column)
        inverse[:, m] = column
    return inverse
