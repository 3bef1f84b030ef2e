"""Scores of the association of two drives whose frames differ by a drift."""

import math
import time
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from ellipseg_ros.association.associate import associate, pair_residual
from ellipseg_ros.association.landmark_map import select_landmarks
from ellipseg_ros.config import AssociationConfig
from ellipseg_ros.records import Array, Association, Kind, Landmarks, Sweep
from studies.landmarks.agreement import MAX_DIFFERENCE, agreeing_pairs, transformed
from studies.landmarks.passes import TwoPasses

DRIFTS = {"0.5 m, 3 degrees": (0.5, 3.0), "3 m, 10 degrees": (3.0, 10.0)}
MAX_LANDMARKS = 500  # of a drive, which are associated in 0.1 s
MIN_COMMON_SHARE = 0.5  # of the points of a correct pair that belong to the same instances
TOLERANCE = 3.0  # of a correct pair, times MAX_DIFFERENCE
WITHOUT_COVARIANCE = AssociationConfig(  # the limits of agreement instead of covariances
    noise=MAX_DIFFERENCE[Kind.PLANE][0],
    angle_noise=math.degrees(MAX_DIFFERENCE[Kind.PLANE][1]),
)

Shares: TypeAlias = dict[int, float]  # of a landmark's points, by instance; empty: not known


class LandmarkSets(NamedTuple):
    """Landmarks of two drives in the frame of the earlier one, with their true instances."""

    earlier: Landmarks
    later: Landmarks
    instances_earlier: list[Shares]
    instances_later: list[Shares]

    def limited(self) -> "LandmarkSets":
        """At most MAX_LANDMARKS of each drive: those with the most points."""
        earlier, later = largest(self.earlier), largest(self.later)
        return LandmarkSets(
            select_landmarks(self.earlier, earlier),
            select_landmarks(self.later, later),
            [self.instances_earlier[row] for row in earlier],
            [self.instances_later[row] for row in later],
        )

    def is_correct(self, pair: Array) -> bool:
        """Whether a pair is close enough and of the same instances."""
        common = common_share(self.instances_earlier[pair[0]], self.instances_later[pair[1]])
        return common >= MIN_COMMON_SHARE and is_close(self.earlier, self.later, pair)


def landmark_sets(passes: TwoPasses, earlier: Landmarks, later: Landmarks) -> LandmarkSets:
    """Landmarks with instances; earlier, later: each in the frame of its own drive."""
    return LandmarkSets(
        earlier,
        transformed(later, passes.T_earlier_later),
        instance_shares(earlier, passes.earlier.sweep),
        instance_shares(later, passes.later.sweep),
    )


def largest(landmarks: Landmarks) -> Array:
    """Rows of the MAX_LANDMARKS landmarks with the most points; ties by row."""
    return np.sort(np.argsort(-landmarks.count, kind="stable")[:MAX_LANDMARKS])


def instance_shares(landmarks: Landmarks, sweep: Sweep) -> list[Shares]:
    """Shares of the instances in the points of every landmark; a wall may be of several."""
    shares: list[Shares] = [{} for _ in range(len(landmarks))]
    if sweep.fields is None or "instance" not in (sweep.fields.dtype.names or ()):
        return shares
    instance = sweep.fields["instance"].astype(np.int64)
    pairs = np.column_stack([landmarks.point_labels, instance])[landmarks.point_labels >= 0]
    rows, counts = np.unique(pairs, axis=0, return_counts=True)
    points = np.bincount(pairs[:, 0], minlength=len(landmarks))
    for (row, number), count in zip(rows, counts, strict=True):
        shares[row][int(number)] = float(count / points[row])
    return shares


def common_share(first: Shares, second: Shares) -> float:
    """Share of the points that belong to the same instances; 1 where it is not known."""
    if not first or not second:
        return 1.0
    return sum(min(share, second.get(number, 0.0)) for number, share in first.items())


def is_close(earlier: Landmarks, later: Landmarks, pair: Array) -> bool:
    """Whether a pair, in one frame, differs by at most TOLERANCE times MAX_DIFFERENCE."""
    i, j = int(pair[0]), int(pair[1])
    residual = pair_residual(earlier, later, (i, j), np.eye(4)).residual
    kind = Kind(earlier.kind[i])
    offsets = {Kind.PLANE: 1, Kind.LINE: 2, Kind.BLOB: 3}[kind]  # the other residuals are angles
    offset, angle = (float(np.linalg.norm(r)) for r in (residual[:offsets], residual[offsets:]))
    max_offset, max_angle = MAX_DIFFERENCE[kind]
    return offset <= TOLERANCE * max_offset and angle <= TOLERANCE * max_angle


def association_scores(
    sets: LandmarkSets, drift: tuple[float, float], seed: int, has_covariance: bool
) -> dict[str, Any]:
    """Associate after a drift (m, degrees) in a random direction; JSON-ready.

    has_covariance: of the landmarks; otherwise the limits of agreement replace it.
    """
    sets = sets.limited()
    earlier, later = sets.earlier, sets.later
    agree = agreeing_pairs(earlier, later).matrix(len(earlier), len(later))
    transform = random_drift(later, drift, np.random.default_rng([seed, round(10 * drift[0])]))
    drifted = transformed(later, np.linalg.inv(transform))
    config = AssociationConfig() if has_covariance else WITHOUT_COVARIANCE
    started = time.process_time()
    result = associate(earlier, drifted, config)
    seconds = time.process_time() - started
    offset, angle = determined_error(result, transform)
    i, j = result.pairs.T
    return {
        "landmarks": [len(earlier), len(later)],
        "verdict": result.verdict.name,
        "undetermined": result.undetermined.shape[1],
        "pairs": len(result),
        "correct": sum(map(sets.is_correct, result.pairs)),
        "agreeing": int(agree[i, j].sum()),
        "possible": int(min(agree.any(axis=0).sum(), agree.any(axis=1).sum())),
        "error_m": offset,
        "error_deg": angle,
        "nees": normalised_error(result, transform),
        "cpu_s": seconds,
    }


def all_scores(sets: LandmarkSets, seed: int, has_covariance: bool) -> dict[str, Any]:
    """The `association_scores` for every drift."""
    return {
        name: association_scores(sets, drift, seed, has_covariance)
        for name, drift in DRIFTS.items()
    }


# --- the transform ---------------------------------------------------------------------------


def random_drift(
    landmarks: Landmarks, drift: tuple[float, float], rng: np.random.Generator
) -> Array:
    """(4, 4) of this size (m, degrees) in random directions, about the landmarks' centroid."""
    axis, direction = rng.normal(size=(2, 3))
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angle = math.radians(drift[1])
    rotation = np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross
    centre = landmarks.position.mean(axis=0) if len(landmarks) else np.zeros(3)
    transform = np.eye(4)
    transform[:3, :3] = rotation
    transform[:3, 3] = (
        centre - rotation @ centre + drift[0] * direction / np.linalg.norm(direction)
    )
    return transform


def transform_error(result: Association, truth: Array) -> Array:
    """(6,) m, rad: motion from the estimated transform to the true one, about the centre."""
    centres = [T[:3, :3] @ result.centre + T[:3, 3] for T in (truth, result.T_earlier_later)]
    rotation = truth[:3, :3] @ result.T_earlier_later[:3, :3].T
    skew = 0.5 * (rotation - rotation.T)
    axis = np.array([skew[2, 1], skew[0, 2], skew[1, 0]])
    sine = float(np.linalg.norm(axis))
    scale = 1.0 if sine < 1e-9 else math.atan2(sine, 0.5 * (np.trace(rotation) - 1.0)) / sine
    return np.concatenate([centres[0] - centres[1], scale * axis])


def determined_error(result: Association, truth: Array) -> tuple[float, float]:
    """Error of the transform in the determined directions: m, degrees."""
    scale = np.repeat([1.0, result.characteristic_length], 3)
    error = transform_error(result, truth) * scale
    error = (error - result.undetermined @ (result.undetermined.T @ error)) / scale
    return float(np.linalg.norm(error[:3])), math.degrees(float(np.linalg.norm(error[3:])))


def normalised_error(result: Association, truth: Array) -> float:
    """Normalised squared error (NEES) of the transform, divided by its six directions."""
    error = transform_error(result, truth)
    return float(error @ np.linalg.solve(result.covariance, error)) / 6.0
