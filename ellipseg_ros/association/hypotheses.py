"""Hypotheses of the transform: proposed by cliques of candidates, tested on all landmarks."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ellipseg_ros.association import constants
from ellipseg_ros.association.candidates import (
    Bounds,
    PairSet,
    clutter,
    consistency,
    find_candidates,
    normal_equations,
)
from ellipseg_ros.association.cliques import maximal_cliques
from ellipseg_ros.association.pairing import DEGREES, LandmarkArrays
from ellipseg_ros.association.registration import Matches, Registration, match, register
from ellipseg_ros.records import Array

LOG_TWO_PI = math.log(2.0 * math.pi)


class Problem(NamedTuple):
    """Two sets of landmarks with their candidate pairs, and what is assumed of both."""

    both: PairSet
    bounds: Bounds
    prior: Array  # (6,) 1/m^2, 1/rad^2: information that the motion about the centre is zero
    clutter: Array  # (later,) log of the largest density of wrong candidates

    @property
    def matchable(self) -> int:
        """How many of the later landmarks have candidates."""
        return int((np.diff(self.both.pairs.starts) > 0).sum())


@dataclass(frozen=True)
class Hypothesis:
    """A transform, and the pairs that it rests on."""

    registration: Registration
    matches: Matches
    gain: Array  # (e,) log likelihood ratio of every match against clutter
    evidence: float  # log odds of the hypothesis against nothing but clutter

    @property
    def pairs(self) -> Array:
        """Rows of the selected candidates."""
        return self.matches.candidate[self.matches.selected]

    @property
    def support(self) -> float:
        """Sum of the log likelihood ratios of its pairs."""
        return float(self.gain[self.matches.selected].sum())

    @property
    def covariance(self) -> Array:
        """(6, 6) of the transform, enlarged if the residuals exceed the pairs' covariances."""
        degrees = 3 * len(self.pairs) - 6
        excess = self.registration.square / degrees if degrees > 0 else 1.0
        return self.registration.covariance * max(1.0, excess)


def association_problem(earlier: LandmarkArrays, later: LandmarkArrays, bounds: Bounds) -> Problem:
    """Find the candidates, and estimate the density of the wrong ones."""
    centre = later.position.mean(axis=0) if len(later.kind) else np.zeros(3)
    # A uniform distribution within +-b has the variance b^2 / 3.
    prior = np.repeat([3.0 / max(b, 1e-6) ** 2 for b in bounds[:2]], 3)
    pairs = find_candidates(earlier, later, centre, bounds)
    both = PairSet(earlier, later, centre, pairs)
    scatter = clutter(both, bounds)
    volume = [
        np.linalg.slogdet(scatter[k, :degrees, :degrees])[1] for k, degrees in enumerate(DEGREES)
    ]
    peak = -0.5 * (np.array(volume) + DEGREES * LOG_TWO_PI)
    density = peak[later.kind] + np.log(np.maximum(np.diff(pairs.starts), 1))
    return Problem(both, bounds, prior, density)


def find_hypotheses(problem: Problem) -> list[Hypothesis]:
    """Transforms that rest on different pairs, by descending evidence."""
    pairs = problem.both.pairs
    if not len(pairs.later):
        return []
    chosen = _least_ambiguous(pairs.starts, pairs.later)
    equations = normal_equations(problem.both, chosen)
    limits = Bounds(*(constants.CONSISTENCY_MARGIN * bound for bound in problem.bounds))
    consistent = consistency(equations, pairs, chosen, problem.prior, limits)
    hypotheses: list[Hypothesis] = []
    for rows in maximal_cliques(consistent, constants.MAX_CLIQUES):
        clique = chosen[rows]
        if any(_is_redundant(clique, chosen, known.pairs) for known in hypotheses):
            continue
        refined = _refine(problem, clique)
        if refined and not any(_share_most(refined.pairs, known.pairs) for known in hypotheses):
            hypotheses.append(refined)
    return sorted(hypotheses, key=lambda hypothesis: -hypothesis.evidence)


def _least_ambiguous(starts: Array, later: Array) -> Array:
    """Rows of the candidates of those later landmarks that have the fewest."""
    counts = np.diff(starts)
    order = np.argsort(counts, kind="stable")
    order = order[counts[order] > 0]
    limit = max(constants.MAX_GRAPH_CANDIDATES, counts[order[0]])
    return np.flatnonzero(np.isin(later, order[np.cumsum(counts[order]) <= limit]))


def _is_redundant(clique: Array, chosen: Array, known: Array) -> bool:
    """Whether a clique is part of a known hypothesis, or too small to rival it."""
    rival = len(np.intersect1d(chosen, known))
    return constants.MIN_CLIQUE_SHARE * rival > len(clique) or _share_most(clique, known)


def _share_most(one: Array, other: Array) -> bool:
    """Whether most pairs of the smaller set are in both."""
    return 2 * len(np.intersect1d(one, other)) >= min(len(one), len(other))


def _refine(problem: Problem, clique: Array) -> Hypothesis | None:
    """Register and match in turn, from a clique; None if it exceeds the bounds or has no pair."""
    chosen, start = clique, np.eye(4)
    for _ in range(constants.MAX_REFINEMENTS):
        registration = register(problem.both, chosen, problem.prior, start)
        if registration is None or _out_of_bounds(registration, problem.bounds):
            return None
        start = registration.transform
        matches = match(problem.both, registration, problem.bounds.gap)
        later = problem.both.pairs.later[matches.candidate]
        gain = matches.log_likelihood_exact - problem.clutter[later]
        selected = matches.selected & (gain > 0.0)
        previous, chosen = chosen, np.sort(matches.candidate[selected])
        if np.array_equal(previous, chosen):
            break
    if registration is None or not len(chosen):
        return None
    evidence = _evidence(problem, registration, gain[selected])
    return Hypothesis(registration, matches._replace(selected=selected), gain, evidence)


def _out_of_bounds(registration: Registration, bounds: Bounds) -> bool:
    """Whether a transform exceeds the bounds by more than two standard deviations."""
    variance = np.diagonal(registration.covariance)
    for part, bound in ((slice(0, 3), bounds.translation), (slice(3, 6), bounds.rotation)):
        doubt = 2.0 * math.sqrt(variance[part].sum())
        if np.linalg.norm(registration.motion[part]) > constants.BOUND_MARGIN * bound + doubt:
            return True
    return False


def _evidence(problem: Problem, registration: Registration, gain: Array) -> float:
    """Log odds of the matches against clutter, by Laplace's approximation over the transform.

    The second term is the cost of a transform that was free to fit (Occam's factor; MacKay,
    Bayesian Interpolation, 1992).
    """
    free = np.log(problem.prior).sum() - registration.log_determinant
    motion = (problem.prior * registration.motion**2).sum()
    n, matched = problem.matchable, len(gain)
    # If any share of n landmarks may be observed again, with equal probability, a given subset of
    # this size is with probability 1 / ((n + 1) binomial(n, matched)).
    ways = math.lgamma(n + 1) - math.lgamma(matched + 1) - math.lgamma(n - matched + 1)
    return float(gain.sum() + 0.5 * (free - motion) - (math.log(n + 1) + ways))
