"""Candidate pairs of landmarks, under any transform within the bounds, and their consistency."""

import math
from typing import NamedTuple

import numpy as np

from ellipseg_ros.association import constants
from ellipseg_ros.association.pairing import (
    IDENTITY,
    MAX_DEGREES,
    MOTIONS,
    LandmarkArrays,
    compare,
    may_match,
    workspace,
)
from ellipseg_ros.core.jit import for_rows, kernel
from ellipseg_ros.core.linalg.cholesky import factorize, solve_lower, solve_upper
from ellipseg_ros.core.linalg.vectors import difference, dot, norm
from ellipseg_ros.errors import InputError
from ellipseg_ros.records import Array


class Bounds(NamedTuple):
    """Largest motion between the two sets, and largest differences of a pair."""

    translation: float  # m, of the centroid of the later set
    rotation: float  # rad, about it
    gap: float  # m between the extents of parts of one surface, or of one line
    ratio: float  # of sizes


class Candidates(NamedTuple):
    """Pairs that may correspond, by later landmark; c of them."""

    starts: Array  # (later + 1,) int64: those of j are starts[j] to starts[j + 1]
    earlier: Array  # (c,) int64, ascending within a later one
    later: Array  # (c,) int64


class PairSet(NamedTuple):
    """Two sets of landmarks and their candidate pairs."""

    earlier: LandmarkArrays
    later: LandmarkArrays
    centre: Array  # (3,) m: centroid of the later set
    pairs: Candidates


class NormalEquations(NamedTuple):
    """Squared residual of each pair after a motion x (6,): x^T matrix x - 2 x^T vector + square.

    The squares are Mahalanobis distances.
    """

    matrix: Array  # (c, 6, 6)
    vector: Array  # (c, 6)
    square: Array  # (c,)


def find_candidates(
    earlier: LandmarkArrays, later: LandmarkArrays, centre: Array, bounds: Bounds
) -> Candidates:
    """Pairs of one kind and of similar size that a motion within the bounds brings together.

    centre (3,) m: centroid of the later set. Raises InputError for too many.
    """
    possible = np.zeros((len(later.kind), len(earlier.kind)), np.bool_)
    for_rows(_gate, len(later.kind), earlier, later, centre, bounds, possible)
    if np.count_nonzero(possible) > constants.MAX_CANDIDATES:
        raise InputError(
            f"more than {constants.MAX_CANDIDATES} pairs of landmarks may correspond; "
            "narrower bounds help",
            "many",
        )
    j, i = np.nonzero(possible)
    return Candidates(np.append(0, np.cumsum(possible.sum(axis=1))), i, j)


@kernel
def _gate(start, stop, earlier, later, centre, bounds, possible):
    for j in range(start, stop):
        lever_arm = norm(difference(later.position[j], centre))
        far = bounds.translation + 2.0 * math.sin(0.5 * bounds.rotation) * lever_arm
        tolerance = (far, bounds.rotation, bounds.gap)
        for i in range(len(earlier.kind)):
            a, b = earlier.size[i], later.size[j]
            if earlier.kind[i] == later.kind[j] and max(a, b) <= bounds.ratio * min(a, b):
                possible[j, i] = may_match(earlier, later, i, j, IDENTITY, tolerance)


def normal_equations(both: PairSet, chosen: Array) -> NormalEquations:
    """Normal equations of the chosen candidates, for a motion about the centre."""
    count = len(chosen)
    made = NormalEquations(np.zeros((count, 6, 6)), np.zeros((count, 6)), np.zeros(count))
    _linearize(*both, chosen, made, workspace())
    return made


@kernel
def _linearize(earlier, later, centre, pairs, chosen, made, work):
    for n in range(len(chosen)):
        i, j = pairs.earlier[chosen[n]], pairs.later[chosen[n]]
        degrees = compare(earlier, later, i, j, IDENTITY, centre, work)
        made.square[n] = add_normal_equations(work, degrees, made.matrix[n], made.vector[n])


@kernel
def add_normal_equations(work, degrees, matrix, vector):
    """Add J^T S^-1 J and -J^T S^-1 r of a compared pair; returns r^T S^-1 r."""
    factorize(work.covariance, degrees)
    work.whitened[:] = work.residual
    solve_lower(work.covariance, degrees, work.whitened)
    for c in range(6):
        solve_lower(work.covariance, degrees, work.jacobian[:, c])
    square = 0.0
    for a in range(degrees):
        square += work.whitened[a] * work.whitened[a]
        for c in range(6):
            vector[c] -= work.jacobian[a, c] * work.whitened[a]
            for d in range(6):
                matrix[c, d] += work.jacobian[a, c] * work.jacobian[a, d]
    return square


def consistency(
    equations: NormalEquations, pairs: Candidates, chosen: Array, prior: Array, bounds: Bounds
) -> Array:
    """(m, m) uint8: whether two of the chosen candidates can both be right.

    They can if they share no landmark, and if the motion that aligns both best, in the sense of
    least squares, is within the bounds and leaves small residuals. prior (6,) 1/m^2, 1/rad^2:
    information that the motion is zero.
    """
    consistent = np.zeros((len(chosen), len(chosen)), np.uint8)
    i, j = pairs.earlier[chosen], pairs.later[chosen]
    _compare_pairs(equations, i, j, prior, bounds, consistent)
    return consistent


@kernel
def _compare_pairs(equations, i, j, prior, bounds, consistent):
    matrix, vector = np.empty((6, 6)), np.empty(6)
    for a in range(len(i)):
        for b in range(a):
            if i[a] == i[b] or j[a] == j[b]:
                continue
            for c in range(6):
                vector[c] = equations.vector[a, c] + equations.vector[b, c]
                for d in range(c + 1):
                    matrix[c, d] = equations.matrix[a, c, d] + equations.matrix[b, c, d]
                matrix[c, c] += prior[c]
            factorize(matrix, 6)
            solve_lower(matrix, 6, vector)
            square = equations.square[a] + equations.square[b]
            for c in range(6):
                square -= vector[c] * vector[c]
            if square > constants.MAX_CONSISTENT_SQUARE:
                continue
            solve_upper(matrix, 6, vector)
            straight, turn = dot(vector[:3], vector[:3]), dot(vector[3:], vector[3:])
            if straight <= bounds.translation**2 and turn <= bounds.rotation**2:
                consistent[a, b] = consistent[b, a] = 1


def clutter(both: PairSet, bounds: Bounds) -> Array:
    """(3, 4, 4): covariance, by kind, of the residuals of wrong pairs.

    Estimated from all candidates, most of which are wrong, and a few pairs uniform within the
    bounds, for kinds with few candidates.
    """
    total, count = np.zeros((3, MAX_DEGREES, MAX_DEGREES)), np.zeros(3)
    _scatter(*both, total, count, workspace())
    variance = bounds.translation**2 / 3.0, bounds.rotation**2 / 3.0  # of a uniform density
    few = constants.CLUTTER_PRIOR_PAIRS
    for kind in range(3):
        total[kind] += few * np.diag(np.where(MOTIONS[kind] < 3, *variance))
        total[kind] /= count[kind] + few
    return total


@kernel
def _scatter(earlier, later, centre, pairs, total, count, work):
    for n in range(len(pairs.earlier)):
        i, j = pairs.earlier[n], pairs.later[n]
        kind = earlier.kind[i]
        degrees = compare(earlier, later, i, j, IDENTITY, centre, work)
        for a in range(degrees):
            for b in range(degrees):
                total[kind, a, b] += work.residual[a] * work.residual[b]
        count[kind] += 1.0
