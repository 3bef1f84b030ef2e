"""How well two passes are associated, whose frames lie apart as by a drift."""

import math
import time
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from ellipseg_ros.association.associate import associate, pair_residual
from ellipseg_ros.association.landmark_map import select_landmarks
from ellipseg_ros.config import AssociationConfig
from ellipseg_ros.records import Array, Association, Kind, Landmarks, Sweep
from studies.landmarks.agreement import (
    BLOB_OFFSET,
    LINE_ANGLE,
    LINE_OFFSET,
    PLANE_ANGLE,
    PLANE_OFFSET,
    agreeing,
    matrix,
    moved,
)
from studies.landmarks.passes import TwoPasses

DRIFTS = {"0.5 m, 3 degrees": (0.5, 3.0), "3 m, 10 degrees": (3.0, 10.0)}
BUDGET = 500  # landmarks of a pass, which associate in 0.1 s: so many of any kind are compared
COMMON = 0.5  # of their points that are of the same things: with fewer, a pair is wrong
LOOSE = 3.0  # times the limits of agreement: farther apart, a pair is wrong
UNSURE = AssociationConfig(noise=PLANE_OFFSET, angle_noise=math.degrees(PLANE_ANGLE))
LIMITS = {  # m, rad
    Kind.PLANE: (PLANE_OFFSET, PLANE_ANGLE),
    Kind.LINE: (LINE_OFFSET, LINE_ANGLE),
    Kind.BLOB: (BLOB_OFFSET, math.inf),
}


Shares: TypeAlias = dict[int, float]  # of a landmark's points, by thing; empty: not known


class Sets(NamedTuple):
    """Landmarks of two passes, in the frame of the earlier one."""

    earlier: Landmarks
    later: Landmarks
    things_earlier: list[Shares]  # of every landmark
    things_later: list[Shares]


def of_budget(landmarks: Landmarks) -> Array:
    """Rows of those of the most points; ties by row."""
    return np.sort(np.argsort(-landmarks.count, kind="stable")[:BUDGET])


def things(landmarks: Landmarks, sweep: Sweep) -> list[Shares]:
    """The things that the points of every landmark are of; a wall may be of several."""
    found: list[Shares] = [{} for _ in range(len(landmarks))]
    if sweep.fields is None or "instance" not in (sweep.fields.dtype.names or ()):
        return found
    instance = sweep.fields["instance"].astype(np.int64)
    pairs = np.column_stack([landmarks.point_labels, instance])[landmarks.point_labels >= 0]
    rows, counts = np.unique(pairs, axis=0, return_counts=True)
    whole = np.bincount(pairs[:, 0], minlength=len(landmarks))
    for (row, thing), count in zip(rows, counts, strict=True):
        found[row][int(thing)] = float(count / whole[row])
    return found


def in_common(one: Shares, other: Shares) -> float:
    """Share of the points that are of the same things; 1 where that is not known."""
    if not one or not other:
        return 1.0
    return sum(min(share, other.get(thing, 0.0)) for thing, share in one.items())


def recognition(sets: Sets, drift: tuple[float, float], seed: int, honest: bool) -> dict[str, Any]:
    """Associate under a drift (m, degrees); numbers for JSON.

    honest: the landmarks know their covariance. Else the limits of agreement stand for it.
    """
    rows = [of_budget(one) for one in sets[:2]]
    earlier, later = select_landmarks(sets.earlier, rows[0]), select_landmarks(sets.later, rows[1])
    same = matrix(agreeing(earlier, later), len(earlier), len(later))
    transform = drifted(later, drift, np.random.default_rng([seed, round(10 * drift[0])]))
    away = moved(later, np.linalg.inv(transform))
    config = AssociationConfig() if honest else UNSURE
    started = time.process_time()
    found = associate(earlier, away, config)
    seconds = time.process_time() - started
    i, j = found.pairs.T
    right = [
        correct(earlier, later, pair)
        and in_common(sets.things_earlier[rows[0][pair[0]]], sets.things_later[rows[1][pair[1]]])
        >= COMMON
        for pair in found.pairs
    ]
    length, angle = known_error(found, transform)
    return {
        "landmarks": [len(earlier), len(later)],
        "verdict": found.verdict.name,
        "unknown": found.undetermined.shape[1],
        "pairs": len(found),
        "right": int(np.sum(right)),
        "agree": int(same[i, j].sum()),
        "there": int(min(same.any(axis=0).sum(), same.any(axis=1).sum())),
        "offset": length,
        "angle": angle,
        "nees": nees(found, transform),
        "seconds": seconds,
    }


def drifted(later: Landmarks, drift: tuple[float, float], rng: np.random.Generator) -> Array:
    """(4, 4) of that size, in a random direction: m, and degrees about the landmarks' centroid."""
    axis, way = rng.normal(size=(2, 3))
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angle = math.radians(drift[1])
    turn = np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross
    centre = later.position.mean(axis=0) if len(later) else np.zeros(3)
    transform = np.eye(4)
    transform[:3, :3] = turn
    transform[:3, 3] = centre - turn @ centre + drift[0] * way / np.linalg.norm(way)
    return transform


def correct(earlier: Landmarks, later: Landmarks, pair: Array) -> bool:
    """Whether a pair, in one frame, lies within LOOSE times the limits of agreement."""
    i, j = int(pair[0]), int(pair[1])
    r = pair_residual(earlier, later, (i, j), np.eye(4)).residual
    kind = Kind(earlier.kind[i])
    straight = {Kind.PLANE: 1, Kind.LINE: 2, Kind.BLOB: 3}[kind]
    offset, angle = (float(np.linalg.norm(part)) for part in (r[:straight], r[straight:]))
    return offset <= LOOSE * LIMITS[kind][0] and angle <= LOOSE * LIMITS[kind][1]


def motion_error(found: Association, transform: Array) -> Array:
    """(6,) m, rad: from the found transform to the true one, about the moved centre."""
    centres = [T[:3, :3] @ found.centre + T[:3, 3] for T in (transform, found.T_earlier_later)]
    turn = transform[:3, :3] @ found.T_earlier_later[:3, :3].T
    skew = 0.5 * (turn - turn.T)
    axis = np.array([skew[2, 1], skew[0, 2], skew[1, 0]])
    sine = float(np.linalg.norm(axis))
    scale = 1.0 if sine < 1e-9 else math.atan2(sine, 0.5 * (np.trace(turn) - 1.0)) / sine
    return np.concatenate([centres[0] - centres[1], scale * axis])


def known_error(found: Association, transform: Array) -> tuple[float, float]:
    """Error along the directions that are said to be known: m, degrees."""
    scale = np.repeat([1.0, found.characteristic_length], 3)
    error = motion_error(found, transform) * scale
    error = (error - found.undetermined @ (found.undetermined.T @ error)) / scale
    return float(np.linalg.norm(error[:3])), math.degrees(float(np.linalg.norm(error[3:])))


def nees(found: Association, transform: Array) -> float:
    """Normalised error squared of the transform, by its six directions."""
    error = motion_error(found, transform)
    return float(error @ np.linalg.solve(found.covariance, error)) / 6.0


def in_one_frame(passes: TwoPasses, here: Landmarks, there: Landmarks) -> Sets:
    """The landmarks of both passes, each in its own frame, and whose they are."""
    return Sets(
        here,
        moved(there, passes.T_earlier_later),
        things(here, passes.earlier.sweep),
        things(there, passes.later.sweep),
    )


def recognitions(sets: Sets, seed: int, honest: bool) -> dict[str, Any]:
    """What `recognition` says, under every drift."""
    return {name: recognition(sets, drift, seed, honest) for name, drift in DRIFTS.items()}
