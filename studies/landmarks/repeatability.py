"""Repeatability: the share of the landmarks of one drive that agree with one of the other."""

from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from ellipseg_ros.association.landmark_map import select_landmarks
from ellipseg_ros.landmarks.innovation import innovations, normalised_squares
from ellipseg_ros.records import Array, Kind, Landmarks
from studies.landmarks.agreement import Pairs, agreeing_pairs, transformed
from studies.landmarks.passes import TwoPasses

MAX_POINT_DISTANCE = 0.3  # m between points of the two drives at the same place
MIN_VISIBLE_SHARE = 0.5  # of a landmark's points that the other drive has points near
MIN_VISIBLE_POINTS = 40  # of the other drive near it, unless the landmark has fewer
MAX_COMPARED = 1000  # landmarks of a drive; of more, every k-th is compared
BATCH = 100  # landmarks that are compared in one call, to bound memory


class Repeated(NamedTuple):
    """Landmarks of one drive, compared with those of the other; row i is landmark i."""

    kind: Array  # (l,)
    repeated: Array  # (l,) bool: agrees with one of the other drive
    visible: Array  # (l,) bool: the other drive has points there


def repeatability(passes: TwoPasses, earlier: Landmarks, later: Landmarks) -> dict[str, Any]:
    """Counts of landmarks, repeated and visible, over both drives, by kind; JSON-ready.

    earlier, later: each in the frame of its own drive.
    """
    cloud, other_cloud = passes.clouds()
    moved = transformed(later, passes.T_earlier_later)
    both = [
        _compare(earlier, moved, cloud, other_cloud),
        _compare(moved, earlier, other_cloud, cloud),
    ]
    return {
        "landmarks": [len(earlier), len(later)],
        "counts": {"all": _tally(both, list(Kind))}
        | {kind.name.lower(): _tally(both, [kind]) for kind in Kind},
    }


def _compare(
    landmarks: Landmarks, others: Landmarks, cloud: Array, other_cloud: Array
) -> Repeated:
    """Compare at most MAX_COMPARED of the landmarks; all in one frame."""
    rows = np.arange(0, len(landmarks), max(1, len(landmarks) // MAX_COMPARED))
    visible = visible_landmarks(landmarks, cloud, other_cloud)[rows]
    return Repeated(landmarks.kind[rows], _is_repeated(landmarks, others, rows), visible)


def visible_landmarks(landmarks: Landmarks, cloud: Array, other_cloud: Array) -> Array:
    """(l,) bool: whether the other drive has points at the landmark, and could have extracted it.

    cloud (n, 3), other_cloud (m, 3): the points of the two drives in one frame.
    """
    rows = np.flatnonzero(landmarks.point_labels >= 0)
    label, count = landmarks.point_labels[rows], len(landmarks)
    if not len(rows):
        return np.zeros(count, bool)
    radius = MAX_POINT_DISTANCE
    distance, _ = cKDTree(other_cloud).query(cloud[rows], distance_upper_bound=radius)
    points = np.bincount(label, minlength=count)
    share = np.bincount(label, np.isfinite(distance), count) / np.maximum(1, points)
    distance, nearest = cKDTree(cloud[rows]).query(other_cloud, distance_upper_bound=radius)
    other_points = np.bincount(label[nearest[np.isfinite(distance)]], minlength=count)
    needed = np.minimum(points, MIN_VISIBLE_POINTS)
    return np.asarray((share >= MIN_VISIBLE_SHARE) & (other_points >= needed))


def _is_repeated(landmarks: Landmarks, others: Landmarks, rows: Array) -> Array:
    """(r,) bool: whether the landmarks `rows` agree with any of the others."""
    batches = np.array_split(rows, -(-len(rows) // BATCH)) if len(rows) else []
    repeated = [
        np.isin(
            np.arange(len(batch)),
            agreeing_pairs(select_landmarks(landmarks, batch), others).earlier,
        )
        for batch in batches
    ]
    return np.concatenate([np.zeros(0, bool), *repeated])


def _tally(both: list[Repeated], kinds: list[Kind]) -> dict[str, int]:
    """Counts over both drives, for landmarks of some kinds."""
    kind, repeated, visible = (np.concatenate(columns) for columns in zip(*both, strict=True))
    chosen = np.isin(kind, kinds)
    return {
        "landmarks": int(chosen.sum()),
        "repeated": int((chosen & repeated).sum()),
        "visible": int((chosen & visible).sum()),
        "visible_repeated": int((chosen & visible & repeated).sum()),
    }


def normalised_errors(
    earlier: Landmarks, later: Landmarks, transform: Array
) -> dict[str, list[float]]:
    """Normalised squared errors of the agreeing pairs, by kind.

    The squared Mahalanobis distance divided by the number of determined motions: 1 on average if
    the covariances are right. transform (4, 4): T_earlier_later.
    """
    moved = transformed(later, transform)
    pairs = agreeing_pairs(earlier, moved)
    covariance = moved.covariance[pairs.later] + transported_covariance(earlier, moved, pairs)
    kind = moved.kind[pairs.later]
    error = innovations(
        kind,
        (earlier.position[pairs.earlier], earlier.axes[pairs.earlier]),
        (moved.position[pairs.later], moved.axes[pairs.later]),
    )
    squared = normalised_squares(kind, error, covariance)
    return {k.name.lower(): [round(float(s), 3) for s in squared[kind == k]] for k in Kind}


def transported_covariance(earlier: Landmarks, later: Landmarks, pairs: Pairs) -> Array:
    """Covariances (p, 6, 6) of earlier landmarks as motions in the axes of the later ones.

    A rotation about one place moves another: the offset far from a landmark is less certain.
    """
    a, b = pairs
    rotation = np.einsum("pji,pjk->pik", later.axes[b], earlier.axes[a])
    arm = np.einsum("pji,pj->pi", later.axes[b], later.position[b] - earlier.position[a])
    cross = np.zeros((len(a), 3, 3))  # the matrix of "arm x"
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = -arm[:, 2], arm[:, 1], -arm[:, 0]
    cross -= cross.transpose(0, 2, 1)
    jacobian = np.zeros((len(a), 6, 6))
    jacobian[:, :3, :3] = jacobian[:, 3:, 3:] = rotation
    jacobian[:, :3, 3:] = -cross @ rotation
    transported: Array = jacobian @ earlier.covariance[a] @ jacobian.transpose(0, 2, 1)
    return transported
