"""Transforms that cliques of candidates propose, put to the test of all landmarks."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ellipseg_ros.association.candidates import (
    Bounds,
    Candidates,
    Limits,
    agreement,
    candidates,
    claims,
    clutter,
)
from ellipseg_ros.association.cliques import cliques
from ellipseg_ros.association.pairing import DEGREES, Things
from ellipseg_ros.association.registration import Fit, Matches, fit, matches
from ellipseg_ros.records import Array

NODES = 600  # candidates of which cliques are made: those of the least ambiguous landmarks
AGREE = 16.0  # limit of the squares of two candidates
CLIQUES = 24
ROUNDS = 8  # of fitting and matching, at most
RIVAL = 0.5  # a clique with less than this share of the pairs of another's is not tested
MARGIN = 1.1  # by which a transform may exceed the bounds
LOOSE = 1.5  # likewise, one that two candidates agree about
LOG_TURN = math.log(2.0 * math.pi)


class Problem(NamedTuple):
    """Two sets of landmarks, and what may be which."""

    earlier: Things
    later: Things
    bounds: Bounds
    centre: Array  # (3,) m: centroid of the later set
    prior: Array  # (6,): information that the centre, and what is about it, moves not at all
    pairs: Candidates
    density: Array  # (later,) log density of wrong candidates where they would fit best


@dataclass(frozen=True)
class Hypothesis:
    """A transform, and the pairs that it rests on."""

    fit: Fit
    matches: Matches
    gain: Array  # (e,) log likelihood of every match, against clutter
    evidence: float  # log odds against nothing but clutter

    @property
    def pairs(self) -> Array:
        """Rows of the candidates."""
        return self.matches.candidate[self.matches.right]

    @property
    def fits(self) -> float:
        """How much its pairs say for it, before its price."""
        return float(self.gain[self.matches.right].sum())

    @property
    def covariance(self) -> Array:
        """(6, 6) of the transform; larger if the pairs lie farther apart than theirs say."""
        degrees = 3 * len(self.pairs) - 6
        excess = self.fit.square / degrees if degrees > 0 else 1.0
        return self.fit.covariance * max(1.0, excess)


def pose(earlier: Things, later: Things, bounds: Bounds) -> Problem:
    """Find the candidates, and how dense the wrong ones are."""
    centre = later.position.mean(axis=0) if len(later.kind) else np.zeros(3)
    # A uniform distribution within +-b has the variance b^2 / 3.
    prior = np.repeat([3.0 / max(b, 1e-6) ** 2 for b in bounds[:2]], 3)
    pairs = candidates(earlier, later, centre, bounds)
    scatter = clutter(earlier, later, centre, pairs, bounds)
    peak = np.array(
        [
            -0.5 * (np.linalg.slogdet(scatter[kind, :rows, :rows])[1] + rows * LOG_TURN)
            for kind, rows in enumerate(DEGREES)
        ]
    )
    density = peak[later.kind] + np.log(np.maximum(np.diff(pairs.starts), 1))
    return Problem(earlier, later, bounds, centre, prior, pairs, density)


def hypotheses(problem: Problem) -> list[Hypothesis]:
    """Transforms of different opinions, by descending evidence."""
    pairs, bounds = problem.pairs, problem.bounds
    if not len(pairs.later):
        return []
    chosen = _least_ambiguous(pairs)
    made = claims(problem.earlier, problem.later, problem.centre, pairs, chosen)
    limits = Limits(problem.prior, AGREE, LOOSE * bounds.translation, LOOSE * bounds.rotation)
    found: list[Hypothesis] = []
    for rows in cliques(agreement(made, pairs, chosen, limits), CLIQUES):
        clique = chosen[rows]
        if any(_needless(clique, chosen, other.pairs) for other in found):
            continue
        tested = _test(problem, clique)
        if tested is not None and not any(_same(tested.pairs, other.pairs) for other in found):
            found.append(tested)
    return sorted(found, key=lambda hypothesis: -hypothesis.evidence)


def hopeful(problem: Problem) -> int:
    """How many of the later landmarks have candidates."""
    return int((np.diff(problem.pairs.starts) > 0).sum())


def _least_ambiguous(pairs: Candidates) -> Array:
    """Rows of candidates, of the later landmarks that have the fewest."""
    counts = np.diff(pairs.starts)
    order = np.argsort(counts, kind="stable")
    order = order[counts[order] > 0]
    within = order[np.cumsum(counts[order]) <= max(NODES, counts[order[0]])]
    return np.flatnonzero(np.isin(pairs.later, within))


def _needless(clique: Array, chosen: Array, known: Array) -> bool:
    """Whether a clique is part of what is known, or too small to rival it."""
    there = len(np.intersect1d(chosen, known))
    return RIVAL * there > len(clique) or _same(clique, known)


def _same(one: Array, other: Array) -> bool:
    """Whether most pairs of the smaller set are in both."""
    return 2 * len(np.intersect1d(one, other)) >= min(len(one), len(other))


def _test(problem: Problem, clique: Array) -> Hypothesis | None:
    """Fit and match in turn, from a clique on; None if that leads out of bounds or to nothing."""
    both = (problem.earlier, problem.later)
    centre, pairs = problem.centre, problem.pairs
    chosen, start = clique, np.eye(4)
    for _ in range(ROUNDS):
        fitted = fit(both, centre, pairs, chosen, problem.prior, start)
        if fitted is None or _beyond(fitted, problem.bounds):
            return None
        start = fitted.transform
        matched = matches(both, centre, pairs, fitted, problem.bounds.gap)
        gain = matched.given - problem.density[pairs.later[matched.candidate]]
        before, chosen = chosen, np.sort(matched.candidate[matched.right & (gain > 0.0)])
        if np.array_equal(before, chosen):
            break
    if fitted is None or not len(chosen):
        return None
    matched = matched._replace(right=matched.right & (gain > 0.0))
    return Hypothesis(fitted, matched, gain, _evidence(problem, fitted, gain[matched.right]))


def _beyond(fitted: Fit, bounds: Bounds) -> bool:
    """Whether a transform is out of bounds for sure: what is hardly determined may be anything."""
    variance = np.diagonal(fitted.covariance)
    for part, bound in ((slice(0, 3), bounds.translation), (slice(3, 6), bounds.rotation)):
        doubt = 2.0 * math.sqrt(variance[part].sum())
        if np.linalg.norm(fitted.motion[part]) > MARGIN * bound + doubt:
            return True
    return False


def _evidence(problem: Problem, fitted: Fit, gain: Array) -> float:
    """Log odds of the matches against clutter, by Laplace's approximation over the transform.

    The second term is what a transform costs that was free to fit (Occam's factor; MacKay,
    Bayesian Interpolation, 1992).
    """
    free = np.log(problem.prior).sum() - fitted.log_determinant
    motion = (problem.prior * fitted.motion**2).sum()
    return float(gain.sum() + 0.5 * (free - motion) - _price(hopeful(problem), len(gain)))


def _price(n: int, matched: int) -> float:
    """Log of how many ways there are for so many of n landmarks to be there again.

    If any share of them may be, with equal probability, then so many certain ones are with
    the probability 1 / ((n + 1) binomial(n, matched)).
    """
    ways = math.lgamma(n + 1) - math.lgamma(matched + 1) - math.lgamma(n - matched + 1)
    return math.log(n + 1) + ways
