"""Correspondences between two sets of landmarks, with the aligning transform.

1. Candidates: pairs of one kind and of similar size that a motion within bounds brings together.
2. Consistency: two candidates are consistent if one motion aligns both. Cliques of the graph of
   consistent candidates propose transforms, by weighted least squares on SE(3).
3. Test: each transform is matched against all landmarks and refined. Its evidence is the
   likelihood of the matches, against that of clutter, less the cost of a free transform.
4. Verdict: transforms that explain nearly as much as the best one make it ambiguous.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from ellipseg_ros.association import constants
from ellipseg_ros.association.candidates import Bounds
from ellipseg_ros.association.hypotheses import (
    Hypothesis,
    Problem,
    association_problem,
    find_hypotheses,
)
from ellipseg_ros.association.landmark_map import ROW_SHAPES
from ellipseg_ros.association.pairing import LandmarkArrays, compare, landmark_arrays, workspace
from ellipseg_ros.config import AssociationConfig
from ellipseg_ros.errors import InputError
from ellipseg_ros.records import DETERMINED, Array, Association, Kind, Landmarks, Verdict


def associate(
    earlier: Landmarks, later: Landmarks, config: AssociationConfig | None = None
) -> Association:
    """Find the landmarks that two sets have in common, and the transform between the sets.

    earlier, later: landmarks, each set in its own frame; the frames may differ by a drift within
    the bounds of `config` (by default 3 m and 10 degrees). The result has the pairs of
    corresponding rows with their probabilities, T_earlier_later with its covariance, and a
    verdict: whether the transform is known, known in some directions only, ambiguous, or whether
    too few landmarks correspond; in that last case there are no pairs, and it is the identity.

    Deterministic; the order of the rows changes nothing but their numbers. Raises InputError for
    landmarks with values that are not finite.
    """
    config = config or AssociationConfig()
    orders = (_canonical_order("earlier", earlier), _canonical_order("later", later))
    bounds = Bounds(
        config.max_translation, math.radians(config.max_rotation), config.gap, config.size_ratio
    )
    arrays = _arrays(earlier, orders[0], config), _arrays(later, orders[1], config)
    problem = association_problem(*arrays, bounds)
    hypotheses = find_hypotheses(problem)
    odds = _probabilities(hypotheses)
    by_chance = 1.0 - odds.sum()
    doubtful = not len(odds) or odds[0] < constants.MIN_TRANSFORM_PROBABILITY
    if doubtful and by_chance >= odds[1:].sum():
        return _without_pairs(problem, np.diag(1.0 / problem.prior), config.known)
    return _conclude(problem, hypotheses, odds, orders, config)


def warm_up() -> None:
    """Compile all kernels of the association, or load them from the cache."""
    count = 2 * len(Kind)
    ones = {name: np.ones((count, *shape), kind) for name, (shape, kind) in ROW_SHAPES.items()}
    example = replace(
        Landmarks(**ones),
        kind=np.arange(count, dtype=np.uint8) // 2,
        position=np.arange(3.0 * count).reshape(count, 3) ** 1.5,
        axes=np.tile(np.eye(3), (count, 1, 1)),
        covariance=np.zeros((count, 6, 6)),
    )
    for row, kind in enumerate(example.kind):
        determined = DETERMINED[Kind(kind)]
        example.covariance[row, determined, determined] = 1e-4
    associate(example, example)


@dataclass(frozen=True)
class Residual:
    """Difference of two landmarks in the d motions that their kind determines."""

    residual: Array  # (d,) m, rad
    jacobian: Array  # (d, 6): derivative by a small motion, translation and rotation, of the
    # later one in the earlier one's frame; about the origin of that frame
    covariance: Array  # (d, d): of the residual, from both landmarks


def pair_residual(
    earlier: Landmarks,
    later: Landmarks,
    pair: tuple[int, int],
    transform: Array,
    config: AssociationConfig | None = None,
) -> Residual:
    """Residual of a pair of landmarks under T_earlier_later (4, 4), as for a pose graph factor.

    pair: rows of the two sets, as in Association.pairs.
    """
    config = config or AssociationConfig()
    one, other = (
        _arrays(landmarks, np.array([row]), config)
        for landmarks, row in zip((earlier, later), pair, strict=True)
    )
    work = workspace()
    d = compare(one, other, 0, 0, transform, np.zeros(3), work)
    return Residual(work.residual[:d], work.jacobian[:d], work.covariance[:d, :d])


def _arrays(landmarks: Landmarks, rows: Array, config: AssociationConfig) -> LandmarkArrays:
    return landmark_arrays(landmarks, rows, config.noise, math.radians(config.angle_noise))


def _canonical_order(name: str, landmarks: Landmarks) -> Array:
    """Rows in an order that depends on the landmarks alone; refuses values that are not finite."""
    for column in ("position", "axes", "sigma", "covariance", "box_min", "box_max"):
        values = getattr(landmarks, column)
        finite = np.isfinite(values).all(axis=tuple(range(1, values.ndim)))
        if not finite.all():
            raise InputError(
                f"landmark {landmarks.ids[~finite][0]} of the {name} set has a value that is not "
                "finite; all must be",
                "not_finite",
            )
    keys = np.column_stack([landmarks.kind, landmarks.count, landmarks.position])
    return np.lexsort(keys.T[::-1])


def _probabilities(hypotheses: list[Hypothesis]) -> Array:
    """(h,) probabilities of the hypotheses; the remainder is that of chance.

    Rivals are weighed by the ratio of their supports, not by the difference, as likelihoods would
    be: which landmarks are observed again is no independent evidence. In a row of equal trees, a
    shift by one tree loses one pair of ten.
    """
    if not hypotheses:
        return np.zeros(0)
    support = np.array([hypothesis.support for hypothesis in hypotheses])
    support += support[0] / max(1, len(hypotheses[0].pairs))  # one pair more or less is little
    weights = np.exp(constants.RIVAL_DECAY * np.minimum(0.0, support / support[0] - 1.0))
    log_chance = constants.CHANCE_EVIDENCE - hypotheses[0].evidence
    chance = math.exp(min(log_chance, constants.MAX_LOG_ODDS))
    return weights / (weights.sum() + chance)


def _conclude(
    problem: Problem,
    hypotheses: list[Hypothesis],
    odds: Array,
    orders: tuple[Array, Array],
    config: AssociationConfig,
) -> Association:
    """The best hypothesis, its uncertainty and its pairs."""
    best, pairs = hypotheses[0], problem.both.pairs
    ambiguous = odds[0] < constants.MIN_TRANSFORM_PROBABILITY  # not probable enough alone
    covariance = _mixture(problem, hypotheses, odds) if ambiguous else best.covariance
    length = _characteristic_length(problem)
    # Drift bends each window: an error that no number of pairs averages out.
    covariance = covariance + np.diag(np.repeat([config.noise, config.noise / length], 3) ** 2)
    result = _without_pairs(problem, covariance, config.known)
    known = Verdict.PARTIAL if result.undetermined.shape[1] else Verdict.KNOWN
    probability = _pair_probabilities(problem, hypotheses, odds)
    good = best.matches.selected & (probability >= config.min_probability)
    candidate = best.matches.candidate[good]
    earlier, later = orders[0][pairs.earlier[candidate]], orders[1][pairs.later[candidate]]
    order = np.argsort(earlier)
    return replace(
        result,
        pairs=np.column_stack([earlier, later])[order],
        probability=probability[good][order],
        distance=np.sqrt(best.matches.square[good][order]),
        T_earlier_later=best.registration.transform,
        verdict=Verdict.AMBIGUOUS if ambiguous else known,
        transform_probability=float(odds[0]),
    )


def _without_pairs(problem: Problem, covariance: Array, known: float) -> Association:
    """The result if the matches may be due to chance: no pairs, and the identity.

    covariance (6, 6): of the transform; known: m, see AssociationConfig.
    """
    length = _characteristic_length(problem)
    return Association(
        pairs=np.zeros((0, 2), np.int64),
        probability=np.zeros(0),
        distance=np.zeros(0),
        T_earlier_later=np.eye(4),
        covariance=covariance,
        centre=problem.both.centre,
        undetermined=_undetermined(covariance, length, known),
        characteristic_length=length,
        verdict=Verdict.TOO_FEW,
        transform_probability=0.0,
    )


def _mixture(problem: Problem, hypotheses: list[Hypothesis], odds: Array) -> Array:
    """Covariance about the best transform of all hypotheses, and of the prior for the rest."""
    total = (1.0 - odds.sum()) * np.diag(1.0 / problem.prior)
    for hypothesis, weight in zip(hypotheses, odds, strict=True):
        offset = hypothesis.registration.motion - hypotheses[0].registration.motion
        total += weight * (hypothesis.covariance + np.outer(offset, offset))
    return total


def _characteristic_length(problem: Problem) -> float:
    """RMS distance of the later landmarks from their centroid; at least 1 m."""
    offset = problem.both.later.position - problem.both.centre
    return max(1.0, math.sqrt((offset**2).sum() / max(1, len(offset))))


def _undetermined(covariance: Array, length: float, known: float) -> Array:
    """(6, k): motions with a standard deviation above `known`, m, rotations as lengths."""
    scale = np.repeat([1.0, length], 3)
    variances, directions = np.linalg.eigh(covariance * np.outer(scale, scale))
    directions = directions[:, variances > known * known]
    largest = np.abs(directions).argmax(axis=0)
    return np.asarray(directions * np.sign(directions[largest, np.arange(len(largest))]))


def _pair_probabilities(problem: Problem, hypotheses: list[Hypothesis], odds: Array) -> Array:
    """(e,) that the matches of the best hypothesis are right: sums over the hypotheses."""
    total = np.zeros(len(problem.both.pairs.later))
    for hypothesis, weight in zip(hypotheses, odds, strict=True):
        total[hypothesis.matches.candidate] += weight * _match_probabilities(problem, hypothesis)
    return total[hypotheses[0].matches.candidate]


def _match_probabilities(problem: Problem, hypothesis: Hypothesis) -> Array:
    """(e,) that a match is right if the transform is: against clutter and its competitors."""
    observed_again = (len(hypothesis.pairs) + 1.0) / (problem.matchable + 2.0)
    gain = hypothesis.gain + math.log(observed_again / (1.0 - observed_again))
    odds = np.exp(np.minimum(gain, constants.MAX_LOG_ODDS))
    earlier, later, _, pairs = problem.both
    candidate = hypothesis.matches.candidate
    i, j = pairs.earlier[candidate], pairs.later[candidate]
    of_i = np.bincount(i, odds, len(earlier.kind))[i]
    of_j = np.bincount(j, odds, len(later.kind))[j]
    return odds / (1.0 + of_i + of_j - odds)
