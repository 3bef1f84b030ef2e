"""What the stamp of an odometry means: the meaning by which neighbouring sweeps agree best."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from ellipseg_ros.config import PlacementConfig
from ellipseg_ros.poses.placer import Event, Placer, outcomes
from ellipseg_ros.records import Array, Sweep

# `scan_end` places clouds as `exact` does: the pose at the stamp is that of the stamp's time.
MEANINGS = {"exact": "exact or scan_end", "scan_begin": "scan_begin"}
PAIRS = 20  # of sweeps that are compared
STEP = 5  # sweeps from one of a pair to the other: on a curve, errors grow with it
QUERIES, TARGETS = 2000, 50_000  # points that are used of the sweeps of a pair
NEIGHBOURS = 12  # points of a plane
MAX_DISTANCE_M = 2.0  # of a point from the other sweep
MAX_THICKNESS, MIN_WIDTH = 0.1, 0.01  # of a plane: ratios of its smaller eigenvalues to the next
CLEAR_RATIO = 0.9  # of two scores, below which the lower one decides


@dataclass(frozen=True)
class StampScores:
    """How well sweeps agree, m: medians of distances from planes, by meaning of the stamp."""

    scores: dict[str, float]  # by `odometry_stamp`; of MEANINGS that could be compared
    pairs: int

    @property
    def best(self) -> str:
        """The meaning that is clearly the best; empty: the drive does not show it."""
        ranked = sorted(self.scores, key=lambda name: self.scores[name])
        if len(ranked) < 2 or self.scores[ranked[0]] > CLEAR_RATIO * self.scores[ranked[1]]:
            return ""
        return ranked[0]


def compare_stamps(events: Iterable[Event], count: int, placement: PlacementConfig) -> StampScores:
    """Place pairs of neighbouring sweeps under every meaning of the stamp, and compare them.

    events: clouds in a sensor's frame, and their poses; iterated once. count: clouds among them.
    """
    first = np.unique(np.linspace(0, max(count - STEP - 1, 0), PAIRS).astype(int)).tolist()
    chosen = {*first, *(k + STEP for k in first)}
    kept: list[Event] = []
    stamps = {}
    number = -1
    for event in events:
        if isinstance(event, Sweep):
            number += 1
            if number not in chosen:
                continue
            stamps[number] = event.stamp_ns
        kept.append(event)
    pairs = [(stamps[k], stamps[k + STEP]) for k in first if k in stamps and k + STEP in stamps]
    scores = {}
    for meaning in MEANINGS:
        score = _score(kept, pairs, replace(placement, odometry_stamp=meaning))
        if score is not None:
            scores[meaning] = score
    return StampScores(scores, len(pairs))


def _score(
    events: Sequence[Event], pairs: list[tuple[int, int]], placement: PlacementConfig
) -> float | None:
    """Mean over the pairs of the median distance, m; None if no pair was placed."""
    placed = {
        outcome.stamp_ns: outcome.points[np.isfinite(outcome.points).all(axis=1)]
        for outcome in outcomes(events, Placer(placement))
        if isinstance(outcome, Sweep)
    }
    medians = [disagreement(placed[a], placed[b]) for a, b in pairs if a in placed and b in placed]
    known = [median for median in medians if median is not None]
    return float(np.mean(known)) if known else None


def disagreement(sweep: Array, other: Array) -> float | None:
    """Distance of points (n, 3) from local planes of other ones (m, 3), m.

    The norm of the medians of planes that face along each of three axes, so that a large ground,
    which shows no horizontal error, does not outweigh the walls. None if fewer than NEIGHBOURS
    points lie beside planes.
    """
    if len(other) <= NEIGHBOURS or not len(sweep):
        return None
    targets = other[:: max(1, len(other) // TARGETS)]
    queries = sweep[:: max(1, len(sweep) // QUERIES)]
    tree = cKDTree(targets)
    near, nearest = tree.query(queries)
    queries, nearest = queries[near < MAX_DISTANCE_M], nearest[near < MAX_DISTANCE_M]
    _, rows = tree.query(targets[nearest], NEIGHBOURS)
    patches = targets[rows.reshape(-1, NEIGHBOURS)]
    means = patches.mean(axis=1)
    centred = patches - means[:, None]
    values, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", centred, centred))
    planar = (values[:, 0] <= MAX_THICKNESS * values[:, 1]) & (
        values[:, 1] >= MIN_WIDTH * values[:, 2]
    )
    if np.count_nonzero(planar) < NEIGHBOURS:
        return None
    normals = vectors[planar, :, 0]
    distances = np.abs(np.einsum("ni,ni->n", (queries - means)[planar], normals))
    _, axes = np.linalg.eigh(normals.T @ normals)
    facing = np.abs(normals @ axes).argmax(axis=1)
    medians = [np.median(distances[facing == axis]) for axis in np.unique(facing)]
    return float(np.linalg.norm(medians))
