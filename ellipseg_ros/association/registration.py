"""The transform between two sets of landmarks, from pairs of them, and pairs from a transform."""

import math
from typing import NamedTuple

import numpy as np

from ellipseg_ros.association.candidates import Candidates, add_claim
from ellipseg_ros.association.pairing import Things, compare, near, scratch, spread
from ellipseg_ros.core.jit import kernel
from ellipseg_ros.core.linalg.cholesky import factorize, solve_lower, solve_upper
from ellipseg_ros.records import Array

STEPS = 10  # of Gauss and Newton, at most; 3 or 4 do
SMALL = 1e-6  # m and rad: no other step comes after one below it
MOST = 1e30  # of information: more is none, but rounding, as the noise of a pair has a floor
LIMITS = np.array([16.27, 18.47, 16.27])  # by kind: 99.9 % of chi^2 with 3, 4, 3 degrees


class Fit(NamedTuple):
    """A transform and what it rests on."""

    transform: Array  # (4, 4) earlier <- later
    information: Array  # (6, 6): translation, rotation; left perturbation at the moved centre
    covariance: Array  # (6, 6): its inverse
    log_determinant: float  # of the information
    motion: Array  # (6,) m, rad: of the centre, and about it, from the identity
    square: float  # sum of squares over the pairs, without the prior


class Matches(NamedTuple):
    """Candidates that fit a transform, by descending likelihood."""

    candidate: Array  # (e,) int64, rows of the candidates
    square: Array  # (e,): Mahalanobis distance, squared, the transform's uncertainty included
    likelihood: Array  # (e,): logarithm of the density, likewise
    given: Array  # (e,): logarithm of the density if the transform is taken as given
    right: Array  # (e,) bool: the first with its landmarks


def fit(
    both: tuple[Things, Things], centre: Array, pairs: Candidates, chosen: Array, prior: Array,
    start: Array,
) -> Fit | None:  # fmt: skip
    """Weighted least squares on SE(3) over the chosen pairs: Gauss-Newton, from a start (4, 4).

    prior (6,): information that the motion of the centre, and about it, is none. None if rounding
    leaves no number to tell, which only absurd covariances of the pairs bring about.
    """
    transform, information, motion = start.copy(), np.zeros((6, 6)), np.zeros(6)
    out = (transform, information, motion)
    square = _fit(*both, centre, pairs, chosen, prior, out, scratch())
    bounded = (np.abs(information) < MOST).all()
    if not (bounded and np.isfinite(motion).all() and math.isfinite(square)):
        return None
    covariance, log_determinant = _inverse(information, prior)
    return Fit(transform, information, covariance, log_determinant, motion, square)


def _inverse(information: Array, prior: Array) -> tuple[Array, float]:
    """The covariance, and the logarithm of the information's determinant.

    The information is the prior's and more. Where that is lost to rounding, beside what other
    directions have, the prior's is put in its place.
    """
    try:
        covariance = np.linalg.inv(information)
    except np.linalg.LinAlgError:
        covariance = np.full((6, 6), np.nan)
    if (np.diagonal(covariance) >= 0.0).all():
        sign, log_determinant = np.linalg.slogdet(information)
        if sign > 0.0:
            return covariance, float(log_determinant)
    scale = 1.0 / np.sqrt(prior)
    values, vectors = np.linalg.eigh(information * np.outer(scale, scale))
    values = np.maximum(values, 1.0)
    half = scale[:, None] * vectors / np.sqrt(values)
    return half @ half.T, float(np.log(values).sum() + np.log(prior).sum())


@kernel
def _fit(earlier, later, centre, pairs, chosen, prior, out, found):
    transform, information, motion = out
    vector, step, factor, place = np.zeros(6), np.zeros(6), np.zeros((6, 6)), np.zeros(3)
    square = 0.0
    for _ in range(STEPS):
        _motion(transform, centre, motion)
        information[:] = 0.0
        square = 0.0
        for k in range(3):
            place[k] = centre[k] + motion[k]
        for k in range(6):
            information[k, k] = prior[k]
            vector[k] = -prior[k] * motion[k]
        for n in chosen:
            i, j = pairs.earlier[n], pairs.later[n]
            rows = compare(earlier, later, i, j, transform, place, found)
            square += add_claim(found, rows, information, vector)
        factor[:] = information
        step[:] = vector
        factorize(factor, 6)
        solve_lower(factor, 6, step)
        solve_upper(factor, 6, step)
        _step(transform, place, step)
        if np.abs(step).max() < SMALL:
            break
    _motion(transform, centre, motion)
    return square


@kernel
def _motion(transform, centre, motion):
    """How the centre moves, and the turn about it as a rotation vector."""
    for k in range(3):
        motion[k] = transform[k, 3] - centre[k]
        for a in range(3):
            motion[k] += transform[k, a] * centre[a]
    trace = transform[0, 0] + transform[1, 1] + transform[2, 2]
    x = 0.5 * (transform[2, 1] - transform[1, 2])
    y = 0.5 * (transform[0, 2] - transform[2, 0])
    z = 0.5 * (transform[1, 0] - transform[0, 1])
    sine = math.sqrt(x * x + y * y + z * z)
    scale = 1.0 if sine < 1e-9 else math.atan2(sine, 0.5 * (trace - 1.0)) / sine
    motion[3], motion[4], motion[5] = x * scale, y * scale, z * scale


@kernel
def _step(transform, place, step):
    """Turn by the rotation vector step[3:] about the place, then move by step[:3] (Rodrigues)."""
    angle = math.sqrt(step[3] ** 2 + step[4] ** 2 + step[5] ** 2)
    a = 1.0 - angle * angle / 6.0 if angle < 1e-4 else math.sin(angle) / angle
    b = 0.5 if angle < 1e-4 else (1.0 - math.cos(angle)) / (angle * angle)
    turn, column = np.empty((3, 3)), np.empty(3)
    w = step[3:]
    for r in range(3):
        for c in range(3):
            turn[r, c] = b * w[r] * w[c]
        turn[r, r] += 1.0 - b * angle * angle
    turn[0, 1] -= a * w[2]
    turn[0, 2] += a * w[1]
    turn[1, 0] += a * w[2]
    turn[1, 2] -= a * w[0]
    turn[2, 0] -= a * w[1]
    turn[2, 1] += a * w[0]
    for c in range(4):
        shift = 1.0 if c == 3 else 0.0
        for r in range(3):
            column[r] = transform[r, c] - shift * place[r]
        for r in range(3):
            turned = turn[r, 0] * column[0] + turn[r, 1] * column[1] + turn[r, 2] * column[2]
            transform[r, c] = turned + shift * (place[r] + step[r])


def matches(
    both: tuple[Things, Things], centre: Array, pairs: Candidates, found: Fit, gap: float
) -> Matches:
    """All candidates that agree with a transform, given its uncertainty."""
    place = centre + found.motion[:3]
    size = len(pairs.earlier)
    candidate, values = np.empty(size, np.int64), np.empty((size, 3))
    given = (found.transform, place, found.covariance, gap)
    earlier, later = both
    count = _match(earlier, later, centre, pairs, given, (candidate, values), scratch())
    order = np.argsort(-values[:count, 1], kind="stable")
    candidate, values = candidate[order], values[order]
    right = _one_to_one(
        pairs.earlier[candidate], pairs.later[candidate], len(earlier.kind), len(later.kind)
    )
    return Matches(candidate, values[:, 0], values[:, 1], values[:, 2], right)


@kernel
def _match(earlier, later, centre, pairs, given, out, found):
    transform, place, uncertainty, gap = given
    candidate, values = out
    certain = np.zeros((6, 6))
    straight = uncertainty[0, 0] + uncertainty[1, 1] + uncertainty[2, 2]
    turn = uncertainty[3, 3] + uncertainty[4, 4] + uncertainty[5, 5]
    count = 0
    for j in range(len(later.kind)):
        lever = 0.0
        for k in range(3):
            lever += (later.position[j, k] - centre[k]) ** 2
        reach = (
            4.0 * math.sqrt(straight) + 4.0 * math.sqrt(turn * lever),
            4.0 * math.sqrt(turn),
            gap,
        )
        for n in range(pairs.starts[j], pairs.starts[j + 1]):
            i = pairs.earlier[n]
            if not near(earlier, later, i, j, transform, reach):
                continue
            rows = compare(earlier, later, i, j, transform, place, found)
            square, log_determinant = spread(found, rows, uncertainty)
            if square <= LIMITS[earlier.kind[i]]:
                candidate[count], values[count, 0] = n, square
                unit = rows * math.log(2.0 * math.pi)
                values[count, 1] = -0.5 * (square + log_determinant + unit)
                square, log_determinant = spread(found, rows, certain)
                values[count, 2] = -0.5 * (square + log_determinant + unit)
                count += math.isfinite(values[count, 2])  # else its noise is lost to rounding
    return count


@kernel
def _one_to_one(i, j, earlier, later):
    """(e,) bool: rows whose landmarks both are in no row before that is taken."""
    right = np.zeros(len(i), np.bool_)
    used_i, used_j = np.zeros(earlier, np.bool_), np.zeros(later, np.bool_)
    for n in range(len(i)):
        if not used_i[i[n]] and not used_j[j[n]]:
            right[n] = used_i[i[n]] = used_j[j[n]] = True
    return right
