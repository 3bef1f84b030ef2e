"""Candidates, their consistency and cliques, and registration, against plain or scipy oracles."""

import itertools

import naive
import numpy as np
import pytest
import worlds
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from worlds import BOUNDS, PRIOR

from ellipseg_ros.association.candidates import (
    Candidates,
    PairSet,
    consistency,
    find_candidates,
    normal_equations,
)
from ellipseg_ros.association.cliques import maximal_cliques
from ellipseg_ros.association.hypotheses import association_problem, find_hypotheses
from ellipseg_ros.association.pairing import compare, workspace
from ellipseg_ros.association.registration import match, register
from ellipseg_ros.records import DETERMINED, Kind

pytestmark = pytest.mark.nojit
DIRECTION = {Kind.PLANE: 2, Kind.LINE: 0, Kind.BLOB: None}


def true_pairs(observations):
    """The observations as arrays, with the true correspondences as candidates."""
    earlier, later = worlds.arrays(observations.earlier), worlds.arrays(observations.later)
    pairs = observations.correspondences[np.argsort(observations.correspondences[:, 1])]
    starts = np.searchsorted(pairs[:, 1], np.arange(len(later.kind) + 1))
    candidates = Candidates(starts, pairs[:, 0].copy(), pairs[:, 1].copy())
    return PairSet(earlier, later, later.position.mean(axis=0), candidates)


def whitened_residuals(both, transform):
    """All residuals of the pairs under a transform, and the whitening matrix of each."""
    turn, shift = transform[:3, :3], transform[:3, 3]
    rows = []
    for i, j in zip(both.pairs.earlier, both.pairs.later, strict=True):
        kind = Kind(both.earlier.kind[i])
        one = both.earlier.position[i], both.earlier.axes[i], both.earlier.covariance[i]
        position = turn @ both.later.position[j] + shift
        other = position, turn @ both.later.axes[j], both.later.covariance[j]
        residual, covariance = naive.landmark_residual(
            DIRECTION[kind], DETERMINED[kind], one, other
        )
        rows.append((residual, np.linalg.inv(np.linalg.cholesky(covariance))))
    return rows


def motion_transform(motion, centre):
    """(4, 4): rotation vector motion[3:] about the centre, then translation motion[:3]."""
    transform = np.eye(4)
    transform[:3, :3] = Rotation.from_rotvec(motion[3:]).as_matrix()
    transform[:3, 3] = centre - transform[:3, :3] @ centre + motion[:3]
    return transform


@pytest.mark.parametrize("seed", range(5))
def test_candidates_contain_every_true_pair(seed):
    rng = np.random.default_rng(seed)
    seen = worlds.observe_twice(worlds.world(rng, 3, 6, 4), rng, 3.0, 10.0)
    a, b = worlds.arrays(seen.earlier), worlds.arrays(seen.later)
    pairs = find_candidates(a, b, b.position.mean(axis=0), BOUNDS)
    held = set(zip(pairs.earlier.tolist(), pairs.later.tolist(), strict=True))
    assert set(map(tuple, seen.correspondences)) <= held
    assert all(a.kind[i] == b.kind[j] for i, j in held)


def test_consistency_of_two_candidates_equals_least_squares():
    rng = np.random.default_rng(30)
    world = worlds.world(rng, 2, 8, 3, size=6.0)
    seen = worlds.observe_twice(world, rng, 2.0, 8.0, 1.0)
    a, b = worlds.arrays(seen.earlier), worlds.arrays(seen.later)
    centre = b.position.mean(axis=0)
    pairs = find_candidates(a, b, centre, BOUNDS)
    chosen = np.arange(min(40, len(pairs.later)))
    equations = normal_equations(PairSet(a, b, centre, pairs), chosen)
    limits = BOUNDS._replace(translation=3.0, rotation=np.radians(15.0))
    consistent = consistency(equations, pairs, chosen, PRIOR, limits)
    assert 0 < consistent.sum() < consistent.size / 2
    for n, m in itertools.combinations(range(len(chosen)), 2):
        shared = pairs.earlier[n] == pairs.earlier[m] or pairs.later[n] == pairs.later[m]
        stack, right = [np.diag(np.sqrt(PRIOR))], [np.zeros(6)]
        for k in (n, m):  # whitened rows
            work = workspace()
            d = compare(a, b, pairs.earlier[k], pairs.later[k], np.eye(4), centre, work)
            white = np.linalg.inv(np.linalg.cholesky(work.covariance[:d, :d]))
            stack.append(white @ work.jacobian[:d])
            right.append(-white @ work.residual[:d])
        matrix, vector = np.concatenate(stack), np.concatenate(right)
        motion = np.linalg.lstsq(matrix, vector, rcond=None)[0]
        square = ((matrix @ motion - vector) ** 2).sum()
        expected = square <= 16.0 and np.linalg.norm(motion[:3]) <= limits.translation
        expected = expected and np.linalg.norm(motion[3:]) <= limits.rotation and not shared
        assert consistent[n, m] == consistent[m, n] == expected


def random_graph(seed, n=24):
    """A sparse random graph with a clique of 6 vertices."""
    rng = np.random.default_rng(seed)
    planted = np.arange(6) * 3
    adjacent = np.triu(rng.random((n, n)) < 0.2, 1)
    adjacent |= adjacent.T
    adjacent[np.ix_(planted, planted)] = ~np.eye(6, dtype=bool)
    return adjacent


@pytest.mark.parametrize("seed", range(10))
def test_cliques_equal_the_plain_twin(seed):
    adjacent = random_graph(seed)
    found = maximal_cliques(adjacent.astype(np.uint8), 8)
    assert [clique.tolist() for clique in found] == naive.maximal_cliques(adjacent, 8)


@pytest.mark.parametrize("seed", range(10))
def test_cliques_are_maximal_and_the_largest_is_large(seed):
    adjacent = random_graph(seed)
    found = maximal_cliques(adjacent.astype(np.uint8), 8)
    assert [len(clique) for clique in found] == sorted(map(len, found), reverse=True)
    for clique in found:
        assert all(adjacent[a, b] for a, b in itertools.combinations(clique, 2))
        outside = np.setdiff1d(np.arange(len(adjacent)), clique)
        assert not adjacent[np.ix_(outside, clique)].all(axis=1).any()
    assert len(found[0]) >= 6


def test_registration_of_blobs_is_the_closed_form_of_umeyama():
    rng = np.random.default_rng(41)
    world = worlds.bushes(rng.uniform(-10.0, 10.0, (12, 3)))
    seen = worlds.observe_twice(world, rng, 2.0, 8.0, 1.0)
    sigma = rng.uniform(0.05, 0.3, len(seen.earlier))
    scale = (sigma**2)[:, None, None] * np.diag([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    seen.earlier.covariance[:] = scale
    both = true_pairs(seen)
    chosen = np.arange(len(both.pairs.later))
    found = register(both, chosen, np.full(6, 1e-12), np.eye(4))
    i, j = both.pairs.earlier, both.pairs.later
    weights = 1.0 / (both.earlier.covariance[i, 0, 0] + both.later.covariance[j, 0, 0])
    expected = naive.umeyama(both.later.position[j], both.earlier.position[i], weights)
    np.testing.assert_allclose(found.transform, expected, atol=1e-7)


def test_registration_of_all_kinds_is_the_least_squares_of_scipy():
    rng = np.random.default_rng(40)
    world = worlds.world(rng, 3, 4, 3, size=12.0)
    both = true_pairs(worlds.observe_twice(world, rng, 2.0, 8.0, 1.0))
    found = register(both, np.arange(len(both.pairs.later)), PRIOR, np.eye(4))
    weights = [white for _, white in whitened_residuals(both, found.transform)]

    def residuals(motion):
        rows = whitened_residuals(both, motion_transform(motion, both.centre))
        parts = [white @ r for (r, _), white in zip(rows, weights, strict=True)]
        return np.concatenate([*parts, np.sqrt(PRIOR) * motion])

    best = least_squares(residuals, np.zeros(6), xtol=1e-12, ftol=1e-12)
    error = best.x - found.motion
    assert error @ found.information @ error < 0.03**2  # of a standard deviation
    assert found.square == pytest.approx((best.fun[:-6] ** 2).sum(), rel=1e-3)


def test_information_is_the_curvature_of_the_cost():
    rng = np.random.default_rng(40)
    world = worlds.world(rng, 3, 4, 3, size=12.0)
    both = true_pairs(worlds.observe_twice(world, rng, 2.0, 8.0, 1.0))
    found = register(both, np.arange(len(both.pairs.later)), PRIOR, np.eye(4))

    def cost(transform):
        total = sum(((w @ r) ** 2).sum() for r, w in whitened_residuals(both, transform))
        motion = transform[:3, :3] @ both.centre + transform[:3, 3] - both.centre
        turn = Rotation.from_matrix(transform[:3, :3]).as_rotvec()
        return total + PRIOR[0] * motion @ motion + PRIOR[3] * turn @ turn

    pivot, best = both.centre + found.motion[:3], cost(found.transform)
    np.testing.assert_allclose(
        found.motion[3:], Rotation.from_matrix(found.transform[:3, :3]).as_rotvec(), atol=1e-12
    )
    np.testing.assert_allclose(found.covariance @ found.information, np.eye(6), atol=1e-9)
    for k, sign in itertools.product(range(6), (-1.0, 1.0)):
        step = np.zeros(6)
        step[k] = sign * 0.3 / np.sqrt(found.information[k, k])
        rise = cost(motion_transform(step, pivot) @ found.transform) - best
        assert rise == pytest.approx(0.09, rel=0.25)  # 0.3^2


def test_matches_are_the_candidates_within_the_gate_one_to_one():
    rng = np.random.default_rng(42)
    seen = worlds.observe_twice(worlds.world(rng, 3, 5, 4, size=8.0), rng, 1.0, 5.0, 1.0)
    a, b = worlds.arrays(seen.earlier), worlds.arrays(seen.later)
    centre = b.position.mean(axis=0)
    both = PairSet(a, b, centre, find_candidates(a, b, centre, BOUNDS))
    rows = list(zip(both.pairs.earlier.tolist(), both.pairs.later.tolist(), strict=True))
    true = [rows.index(tuple(pair)) for pair in seen.correspondences.tolist()]
    found = match(both, register(both, np.array(true), PRIOR, np.eye(4)), BOUNDS.gap)
    assert (np.diff(found.log_likelihood) <= 0.0).all()
    selected = found.candidate[found.selected]
    assert len(set(both.pairs.earlier[selected])) == len(selected)
    assert len(set(both.pairs.later[selected])) == len(selected)
    assert len(set(selected) & set(true)) > 0.8 * len(true)


def test_hypotheses_come_by_descending_evidence():
    rng = np.random.default_rng(60)
    seen = worlds.observe_twice(worlds.world(rng, 3, 6, 4, size=12.0), rng, 1.0, 5.0, 1.0)
    problem = association_problem(worlds.arrays(seen.earlier), worlds.arrays(seen.later), BOUNDS)
    evidence = [hypothesis.evidence for hypothesis in find_hypotheses(problem)]
    assert evidence == sorted(evidence, reverse=True) and evidence[0] > 20.0
