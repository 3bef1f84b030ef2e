"""Registration of two sets of landmarks: the transform from pairs, and pairs from a transform."""

import math
from typing import NamedTuple

import numpy as np

from ellipseg_ros.association import constants
from ellipseg_ros.association.candidates import PairSet, add_normal_equations
from ellipseg_ros.association.pairing import compare, mahalanobis, may_match, workspace
from ellipseg_ros.core.jit import kernel
from ellipseg_ros.core.linalg.cholesky import factorize, solve
from ellipseg_ros.records import Array


class Registration(NamedTuple):
    """A transform and its uncertainty.

    Small motions, translation and rotation, are left perturbations about the moved centre.
    """

    transform: Array  # (4, 4) earlier <- later
    information: Array  # (6, 6) 1/m^2, 1/rad^2
    covariance: Array  # (6, 6) m^2, rad^2: its inverse
    log_determinant: float  # of the information
    motion: Array  # (6,) m, rad: translation of the centre, rotation vector about it
    square: float  # sum of the squared Mahalanobis distances of the pairs, without the prior


class Matches(NamedTuple):
    """Candidates that fit a transform, by descending likelihood."""

    candidate: Array  # (e,) int64, rows of the candidates
    square: Array  # (e,): squared Mahalanobis distance, with the transform's uncertainty
    log_likelihood: Array  # (e,): logarithm of the density, with the transform's uncertainty
    log_likelihood_exact: Array  # (e,): the same if the transform is taken as exact
    selected: Array  # (e,) bool: one to one, the most likely first


def register(both: PairSet, chosen: Array, prior: Array, start: Array) -> Registration | None:
    """Weighted least squares on SE(3) over the chosen pairs, by Gauss-Newton from a start (4, 4).

    prior (6,) 1/m^2, 1/rad^2: information that the motion of the centre, and about it, is zero.
    Returns None if rounding leaves no finite result, as absurd covariances can bring about.
    """
    transform, information, motion = start.copy(), np.zeros((6, 6)), np.zeros(6)
    out = (transform, information, motion)
    square = _gauss_newton(*both, chosen, prior, out, workspace())
    bounded = (np.abs(information) < constants.MAX_INFORMATION).all()
    if not (bounded and np.isfinite(motion).all() and math.isfinite(square)):
        return None
    covariance, log_determinant = _invert(information, prior)
    return Registration(transform, information, covariance, log_determinant, motion, square)


def _invert(information: Array, prior: Array) -> tuple[Array, float]:
    """The covariance, and the logarithm of the information's determinant.

    The information is at least the prior's. Where rounding has lost that, beside the much larger
    information of other directions, the prior's is restored.
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
def _gauss_newton(earlier, later, centre, pairs, chosen, prior, out, work):
    transform, information, motion = out
    step, factor, pivot = np.zeros(6), np.zeros((6, 6)), np.zeros(3)
    square = 0.0
    for _ in range(constants.MAX_STEPS):
        _motion_of(transform, centre, motion)
        information[:] = 0.0
        square = 0.0
        pivot[:] = centre + motion[:3]
        for k in range(6):
            information[k, k] = prior[k]
            step[k] = -prior[k] * motion[k]
        for n in chosen:
            i, j = pairs.earlier[n], pairs.later[n]
            degrees = compare(earlier, later, i, j, transform, pivot, work)
            square += add_normal_equations(work, degrees, information, step)
        factor[:] = information
        factorize(factor, 6)
        solve(factor, 6, step)
        _perturb(transform, pivot, step)
        if np.abs(step).max() < constants.STEP_TOLERANCE:
            break
    _motion_of(transform, centre, motion)
    return square


@kernel
def _motion_of(transform, centre, motion):
    """Write the translation of the centre, and the rotation vector about it."""
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
def _perturb(transform, pivot, step):
    """Rotate by the vector step[3:] about the pivot, then translate by step[:3] (Rodrigues)."""
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
        column[:] = transform[:3, c] - shift * pivot
        for r in range(3):
            turned = turn[r, 0] * column[0] + turn[r, 1] * column[1] + turn[r, 2] * column[2]
            transform[r, c] = turned + shift * (pivot[r] + step[r])


def match(both: PairSet, registration: Registration, gap: float) -> Matches:
    """All candidates whose residual is within the gate, given the transform's uncertainty.

    gap: m, between the boxes of a pair along its surface or line.
    """
    size = len(both.pairs.earlier)
    candidate, values = np.empty(size, np.int64), np.empty((size, 3))
    pivot = both.centre + registration.motion[:3]
    given = (registration.transform, pivot, registration.covariance, gap)
    count = _match(*both, given, (candidate, values), workspace())
    order = np.argsort(-values[:count, 1], kind="stable")
    candidate, values = candidate[order], values[order]
    i, j = both.pairs.earlier[candidate], both.pairs.later[candidate]
    selected = _one_to_one(i, j, len(both.earlier.kind), len(both.later.kind))
    return Matches(candidate, values[:, 0], values[:, 1], values[:, 2], selected)


@kernel
def _match(earlier, later, centre, pairs, given, out, work):
    transform, pivot, uncertainty, gap = given
    candidate, values = out
    exact, sigmas = np.zeros((6, 6)), constants.BOUND_SIGMAS
    straight = uncertainty[0, 0] + uncertainty[1, 1] + uncertainty[2, 2]
    turn = uncertainty[3, 3] + uncertainty[4, 4] + uncertainty[5, 5]
    count = 0
    for j in range(len(later.kind)):
        radius = 0.0
        for k in range(3):
            radius += (later.position[j, k] - centre[k]) ** 2
        far = sigmas * math.sqrt(straight) + sigmas * math.sqrt(turn * radius)
        tolerance = (far, sigmas * math.sqrt(turn), gap)
        for n in range(pairs.starts[j], pairs.starts[j + 1]):
            i = pairs.earlier[n]
            if not may_match(earlier, later, i, j, transform, tolerance):
                continue
            degrees = compare(earlier, later, i, j, transform, pivot, work)
            square, log_determinant = mahalanobis(work, degrees, uncertainty)
            if square <= constants.GATES[earlier.kind[i]]:
                candidate[count], values[count, 0] = n, square
                unit = degrees * math.log(2.0 * math.pi)
                values[count, 1] = -0.5 * (square + log_determinant + unit)
                square, log_determinant = mahalanobis(work, degrees, exact)
                values[count, 2] = -0.5 * (square + log_determinant + unit)
                count += math.isfinite(values[count, 2])  # else rounding has lost its covariance
    return count


@kernel
def _one_to_one(i, j, earlier, later):
    """(e,) bool: select every row both of whose landmarks are in no row selected before."""
    selected = np.zeros(len(i), np.bool_)
    used_i, used_j = np.zeros(earlier, np.bool_), np.zeros(later, np.bool_)
    for n in range(len(i)):
        if not used_i[i[n]] and not used_j[j[n]]:
            selected[n] = used_i[i[n]] = used_j[j[n]] = True
    return selected
