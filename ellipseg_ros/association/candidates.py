"""Which landmark of before may be which of now, under any transform within the bounds."""

import math
from typing import NamedTuple

import numpy as np

from ellipseg_ros.association.pairing import DEGREES, MOST, Things, compare, near, scratch
from ellipseg_ros.core.jit import for_rows, kernel
from ellipseg_ros.core.linalg.cholesky import factorize, solve_lower, solve_upper
from ellipseg_ros.errors import InputError
from ellipseg_ros.records import Array

IDENTITY = np.eye(4)
MOST_PAIRS = (
    2_000_000  # that are looked at: thousands of landmarks that are all alike tell nothing
)


class Bounds(NamedTuple):
    """How far the two sets may lie apart, and what else decides about candidates."""

    translation: float  # m, of the centroid of the later set
    rotation: float  # rad, about it
    gap: float  # m between the extents of what is one surface, or one line
    ratio: float  # of sizes


class Candidates(NamedTuple):
    """Pairs that may be right, by later landmark; c of them."""

    starts: Array  # (later + 1,) int64: those of j are starts[j] to starts[j + 1]
    earlier: Array  # (c,) int64, ascending within a later one
    later: Array  # (c,) int64


class Claims(NamedTuple):
    """What each pair says of the motion x (6,): x^T matrix x - 2 x^T vector + square."""

    matrix: Array  # (c, 6, 6)
    vector: Array  # (c, 6)
    square: Array  # (c,)


def candidates(earlier: Things, later: Things, centre: Array, bounds: Bounds) -> Candidates:
    """Pairs of one kind and of like size, near enough to be one after a motion within bounds.

    Raises InputError for more than MOST_PAIRS, each of which costs memory.
    """
    counts = np.zeros(len(later.kind) + 1, np.int64)
    possible = np.zeros((len(later.kind), len(earlier.kind)), np.bool_)
    for_rows(_gate, len(later.kind), earlier, later, centre, bounds, possible)
    if np.count_nonzero(possible) > MOST_PAIRS:
        raise InputError(
            f"more than {MOST_PAIRS} pairs of landmarks may be the same; narrower bounds help",
            "many",
        )
    j, i = np.nonzero(possible)
    np.cumsum(np.bincount(j, minlength=len(later.kind)), out=counts[1:])
    return Candidates(counts, i, j)


@kernel
def _gate(start, stop, earlier, later, centre, bounds, possible):
    translation, rotation, gap, ratio = bounds
    for j in range(start, stop):
        lever = 0.0
        for k in range(3):
            lever += (later.position[j, k] - centre[k]) ** 2
        far = translation + 2.0 * math.sin(0.5 * rotation) * math.sqrt(lever)
        reach = (far, rotation, gap)
        for i in range(len(earlier.kind)):
            if earlier.kind[i] != later.kind[j]:
                continue
            a, b = earlier.thickness[i], later.thickness[j]
            if max(a, b) <= ratio * min(a, b):
                possible[j, i] = near(earlier, later, i, j, IDENTITY, reach)


def claims(
    earlier: Things, later: Things, centre: Array, pairs: Candidates, chosen: Array
) -> Claims:
    """What the chosen candidates say of the motion, about the centre."""
    made = Claims(np.zeros((len(chosen), 6, 6)), np.zeros((len(chosen), 6)), np.zeros(len(chosen)))
    _claim(earlier, later, centre, pairs, chosen, made, scratch())
    return made


@kernel
def _claim(earlier, later, centre, pairs, chosen, made, found):
    for n in range(len(chosen)):
        i, j = pairs.earlier[chosen[n]], pairs.later[chosen[n]]
        rows = compare(earlier, later, i, j, IDENTITY, centre, found)
        made.square[n] = add_claim(found, rows, made.matrix[n], made.vector[n])


@kernel
def add_claim(found, rows, matrix, vector):
    """Add J^T S^-1 J and -J^T S^-1 r of a compared pair; return r^T S^-1 r."""
    factorize(found.noise, rows)
    found.white[:] = found.r
    solve_lower(found.noise, rows, found.white)
    for c in range(6):
        solve_lower(found.noise, rows, found.jacobian[:, c])
    square = 0.0
    for a in range(rows):
        square += found.white[a] * found.white[a]
        for c in range(6):
            vector[c] -= found.jacobian[a, c] * found.white[a]
            for d in range(6):
                matrix[c, d] += found.jacobian[a, c] * found.jacobian[a, d]
    return square


class Limits(NamedTuple):
    """What the motion of two candidates that agree must keep to."""

    prior: Array  # (6,): information that it is none
    square: float  # at most, its own by the prior included
    translation: float  # m
    rotation: float  # rad


def agreement(made: Claims, pairs: Candidates, chosen: Array, limits: Limits) -> Array:
    """(m, m) uint8: whether two of the chosen candidates can be right at once.

    They can if no landmark is in both, and if the motion that brings them together best, in the
    sense of least squares, keeps to the limits.
    """
    agree = np.zeros((len(chosen), len(chosen)), np.uint8)
    i, j = pairs.earlier[chosen], pairs.later[chosen]
    _agree(made, i, j, limits, agree)
    return agree


@kernel
def _agree(made, i, j, limits, agree):
    prior, limit, translation, rotation = limits
    matrix, vector = np.empty((6, 6)), np.empty(6)
    for a in range(len(i)):
        for b in range(a):
            if i[a] == i[b] or j[a] == j[b]:
                continue
            for c in range(6):
                vector[c] = made.vector[a, c] + made.vector[b, c]
                for d in range(c + 1):
                    matrix[c, d] = made.matrix[a, c, d] + made.matrix[b, c, d]
                matrix[c, c] += prior[c]
            factorize(matrix, 6)
            solve_lower(matrix, 6, vector)
            square = made.square[a] + made.square[b]
            for c in range(6):
                square -= vector[c] * vector[c]
            if square > limit:
                continue
            solve_upper(matrix, 6, vector)
            straight = vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2
            turn = vector[3] ** 2 + vector[4] ** 2 + vector[5] ** 2
            if straight <= translation**2 and turn <= rotation**2:
                agree[a, b] = agree[b, a] = 1


def clutter(
    earlier: Things, later: Things, centre: Array, pairs: Candidates, bounds: Bounds
) -> Array:
    """(3, 4, 4): by kind, covariance of what candidates differ by, most of which are wrong.

    With a little of what the bounds alone would say, for kinds with few candidates.
    """
    total, count = np.zeros((3, MOST, MOST)), np.zeros(3)
    _scatter(earlier, later, centre, pairs, total, count, scratch())
    few = 2.0
    for kind, degrees in enumerate(DEGREES):
        expected = np.full(MOST, bounds.translation**2 / 3.0)
        expected[1 if kind == 0 else 2 if kind == 1 else 3 : degrees] = bounds.rotation**2 / 3.0
        total[kind] = (total[kind] + few * np.diag(expected)) / (count[kind] + few)
    return total


@kernel
def _scatter(earlier, later, centre, pairs, total, count, found):
    for n in range(len(pairs.earlier)):
        i, j = pairs.earlier[n], pairs.later[n]
        kind = earlier.kind[i]
        rows = compare(earlier, later, i, j, IDENTITY, centre, found)
        for a in range(rows):
            for b in range(rows):
                total[kind, a, b] += found.r[a] * found.r[b]
        count[kind] += 1.0
