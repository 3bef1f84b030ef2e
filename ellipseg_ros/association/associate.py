"""Which landmarks of now are which of before, and how the two sets lie to one another.

1. Candidates: pairs of one kind and of like size that a motion within bounds brings together.
2. Consistency: two candidates agree if one motion brings both together. Cliques of candidates
   that all agree give transforms, by weighted least squares on SE(3).
3. Test: each transform is put to all landmarks and refined by those that fit it. Its evidence is
   the likelihood of what fits, against that of clutter, less what a free transform fits anyway.
4. Verdict: transforms that explain nearly as much as the best one make it doubtful.
"""

import math
from dataclasses import dataclass

import numpy as np

from ellipseg_ros.association.candidates import Bounds
from ellipseg_ros.association.hypotheses import Hypothesis, Problem, hopeful, hypotheses, pose
from ellipseg_ros.association.pairing import compare, scratch, things
from ellipseg_ros.config import AssociationConfig
from ellipseg_ros.errors import InputError
from ellipseg_ros.records import DETERMINED, Array, Association, Kind, Landmarks, Verdict

CHANCE = 5.0  # evidence that chance gives now and then
LEAST = 0.95  # probability of a transform that is not called doubtful
MOST_GAIN = 50.0  # of a match: beyond, exp only overflows
RIVALRY = 8.0  # a rival whose pairs say 1 - x of what the best ones say has odds of exp(-8 x)


def associate(
    earlier: Landmarks, later: Landmarks, config: AssociationConfig | None = None
) -> Association:
    """Find the pairs and the transform; `verdict` says what can be told.

    Deterministic, and but for their numbering independent of the order of the rows. Raises
    InputError for landmarks that are not finite.
    """
    config = config or AssociationConfig()
    orders = (_order("earlier", earlier), _order("later", later))
    noise = (config.noise, math.radians(config.angle_noise))
    bounds = Bounds(
        config.max_translation, math.radians(config.max_rotation), config.gap, config.size_ratio
    )
    problem = pose(things(earlier, orders[0], *noise), things(later, orders[1], *noise), bounds)
    found = hypotheses(problem)
    odds = _odds(found)
    by_chance = 1.0 - odds.sum()
    if not len(odds) or (odds[0] < LEAST and by_chance >= odds[1:].sum()):
        return _nothing(problem, config)
    return _conclude(problem, found, odds, orders, config)


def warm_up() -> None:
    """Compile all kernels, or load them from the cache."""
    kind = np.repeat(np.array(list(Kind), np.uint8), 2)
    n = len(kind)
    covariance = np.zeros((n, 6, 6))
    for row, motions in enumerate(DETERMINED[Kind(k)] for k in kind):
        covariance[row, motions, motions] = 1e-4
    small = Landmarks(
        ids=np.arange(1, n + 1, dtype=np.uint32),
        kind=kind,
        count=np.full(n, 10),
        position=np.arange(3.0 * n).reshape(n, 3) ** 1.5,
        axes=np.tile(np.eye(3), (n, 1, 1)),
        sigma=np.ones((n, 3)),
        box_min=-np.ones((n, 3)),
        box_max=np.ones((n, 3)),
        covariance=covariance,
        stability=np.zeros(n),
        first_seen_ns=np.zeros(n, np.int64),
    )
    associate(small, small)


@dataclass(frozen=True)
class Difference:
    """How far one landmark lies from another, in the d motions that their kind determines."""

    r: Array  # (d,) m, rad
    jacobian: Array  # (d, 6): its change with a small motion, translation and rotation, of the
    # later one in the earlier one's frame; about the origin of that frame
    covariance: Array  # (d, d): of both landmarks


def difference(
    earlier: Landmarks,
    later: Landmarks,
    pair: tuple[int, int],
    transform: Array,
    config: AssociationConfig | None = None,
) -> Difference:
    """Compare two landmarks under T_earlier_later (4, 4): what a factor of a pose graph needs.

    pair: rows of the two sets, as in Association.pairs.
    """
    config = config or AssociationConfig()
    noise = (config.noise, math.radians(config.angle_noise))
    one, other = (
        things(landmarks, np.array([row]), *noise)
        for landmarks, row in zip((earlier, later), pair, strict=True)
    )
    found = scratch()
    rows = compare(one, other, 0, 0, transform, np.zeros(3), found)
    return Difference(found.r[:rows], found.jacobian[:rows], found.noise[:rows, :rows])


def _order(name: str, landmarks: Landmarks) -> Array:
    """Rows in an order that depends on the landmarks alone; refuses what is not finite."""
    parts = [landmarks.position, landmarks.axes, landmarks.sigma, landmarks.covariance]
    for column in (*parts, landmarks.box_min, landmarks.box_max):
        fine = np.isfinite(column).all(axis=tuple(range(1, column.ndim)))
        if not fine.all():
            raise InputError(
                f"landmark {landmarks.ids[~fine][0]} of the {name} set has a value that is not "
                "finite; all must be",
                "not_finite",
            )
    keys = np.column_stack([landmarks.kind, landmarks.count, landmarks.position])
    return np.lexsort(keys.T[::-1])


def _odds(found: list[Hypothesis]) -> Array:
    """(h,) probabilities of the hypotheses; the rest is that of chance.

    Rivals are weighed by the ratio of what their pairs say, not by its difference, as likelihoods
    would have it: which landmarks are seen again is no independent evidence. In a row of equal
    trees, a shift by one tree loses one pair of ten.
    """
    if not found:
        return np.zeros(0)
    fits = np.array([hypothesis.fits for hypothesis in found])
    fits += fits[0] / max(1, len(found[0].pairs))  # a pair more or less says little
    weights = np.exp(RIVALRY * np.minimum(0.0, fits / fits[0] - 1.0))
    chance = math.exp(min(CHANCE - found[0].evidence, MOST_GAIN))
    return weights / (weights.sum() + chance)


def _conclude(
    problem: Problem,
    found: list[Hypothesis],
    odds: Array,
    orders: tuple[Array, Array],
    config: AssociationConfig,
) -> Association:
    """The best hypothesis, as far as the others let it stand."""
    best = found[0]
    doubtful = odds[0] < LEAST
    covariance = _mixture(problem, found, odds) if doubtful else best.covariance
    covariance = covariance + _common_error(problem, config.noise)
    unknown, lever = _unknown(problem, covariance, config.known)
    known = Verdict.PARTIAL if unknown.shape[1] else Verdict.KNOWN
    probability = _probabilities(problem, found, odds)
    right = best.matches.right & (probability >= config.min_probability)
    candidate = best.matches.candidate[right]
    earlier = orders[0][problem.pairs.earlier[candidate]]
    order = np.argsort(earlier)
    return Association(
        pairs=np.column_stack([earlier, orders[1][problem.pairs.later[candidate]]])[order],
        probability=probability[right][order],
        distance=np.sqrt(best.matches.square[right][order]),
        T_earlier_later=best.fit.transform,
        covariance=covariance,
        centre=problem.centre,
        undetermined=unknown,
        characteristic_length=lever,
        verdict=Verdict.AMBIGUOUS if doubtful else known,
        transform_probability=float(odds[0]),
    )


def _nothing(problem: Problem, config: AssociationConfig) -> Association:
    """What can be said if what agrees may agree by chance: the bounds."""
    covariance = np.diag(1.0 / problem.prior)
    unknown, lever = _unknown(problem, covariance, config.known)
    return Association(
        pairs=np.zeros((0, 2), np.int64),
        probability=np.zeros(0),
        distance=np.zeros(0),
        T_earlier_later=np.eye(4),
        covariance=covariance,
        centre=problem.centre,
        undetermined=unknown,
        characteristic_length=lever,
        verdict=Verdict.TOO_FEW,
        transform_probability=0.0,
    )


def _mixture(problem: Problem, found: list[Hypothesis], odds: Array) -> Array:
    """Covariance about the best transform, of all hypotheses and of the bounds for the rest."""
    total = (1.0 - odds.sum()) * np.diag(1.0 / problem.prior)
    for hypothesis, weight in zip(found, odds, strict=True):
        apart = hypothesis.fit.motion - found[0].fit.motion
        total += weight * (hypothesis.covariance + np.outer(apart, apart))
    return total


def _common_error(problem: Problem, noise: float) -> Array:
    """What no number of pairs averages out: each window is bent by the drift within it."""
    return np.diag(np.repeat([noise, noise / _lever(problem)], 3) ** 2)


def _lever(problem: Problem) -> float:
    """Distance of the later landmarks from their centroid, as root mean square; at least 1 m."""
    apart = problem.later.position - problem.centre
    return max(1.0, math.sqrt((apart**2).sum() / max(1, len(apart))))


def _unknown(problem: Problem, covariance: Array, known: float) -> tuple[Array, float]:
    """The motions that are not known, rotations as lengths at a lever; and the lever."""
    lever = _lever(problem)
    scale = np.repeat([1.0, lever], 3)
    variances, directions = np.linalg.eigh(covariance * np.outer(scale, scale))
    directions = directions[:, variances > known * known]
    largest = np.abs(directions).argmax(axis=0)
    return directions * np.sign(directions[largest, np.arange(len(largest))]), lever


def _probabilities(problem: Problem, found: list[Hypothesis], odds: Array) -> Array:
    """(e,) that the matches of the best hypothesis are right: sums over the hypotheses."""
    share = np.zeros(len(problem.pairs.later))
    for hypothesis, weight in zip(found, odds, strict=True):
        share[hypothesis.matches.candidate] += weight * _shares(problem, hypothesis)
    return share[found[0].matches.candidate]


def _shares(problem: Problem, hypothesis: Hypothesis) -> Array:
    """(e,) that a match is right if the transform is: against clutter and its competitors."""
    again = (len(hypothesis.pairs) + 1.0) / (hopeful(problem) + 2.0)  # share that is there again
    gain = hypothesis.gain + math.log(again / (1.0 - again))
    odds = np.exp(np.minimum(gain, MOST_GAIN))
    candidate = hypothesis.matches.candidate
    i, j = problem.pairs.earlier[candidate], problem.pairs.later[candidate]
    of_i = np.bincount(i, odds, len(problem.earlier.kind))[i]
    of_j = np.bincount(j, odds, len(problem.later.kind))[j]
    return odds / (1.0 + of_i + of_j - odds)
