"""How much of what one pass finds, the other finds again."""

from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from ellipseg_ros.association.landmark_map import select_landmarks
from ellipseg_ros.landmarks.innovation import innovations, normalised_squares
from ellipseg_ros.records import Array, Kind, Landmarks
from studies.landmarks.agreement import Pairs, agreeing, matrix, moved
from studies.landmarks.passes import TwoPasses

CLOSE = 0.3  # m between points of the two passes that saw the same
SHARE = 0.5  # of a landmark's points that the other pass must have seen
LEAST = 40  # points that it must have there, if the landmark has as many
MOST = 1000  # landmarks of a pass that are asked for
AT_ONCE = 100


class Truth(NamedTuple):
    """The landmarks of two passes, each in its own frame, and how they truly belong together."""

    earlier: Landmarks
    later: Landmarks
    T_earlier_later: Array  # (4, 4)
    same: Array  # (earlier, later) bool: they agree in what their shape determines
    seen_earlier: Array  # (earlier,) bool: the later pass saw what is there
    seen_later: Array  # (later,) bool


def truth(passes: TwoPasses, earlier: Landmarks, later: Landmarks) -> Truth:
    """Which of the landmarks found in two passes truly are the same; for some thousands at most.

    One landmark may agree with several of the other pass, and then is the same as each.
    """
    there = moved(later, passes.T_earlier_later)
    cloud, other = _clouds(passes)
    return Truth(
        earlier,
        later,
        passes.T_earlier_later,
        matrix(agreeing(earlier, there), len(earlier), len(later)),
        seen(earlier, cloud, other),
        seen(there, other, cloud),
    )


def _clouds(passes: TwoPasses) -> tuple[Array, Array]:
    """The points of both passes, in the frame of the earlier one."""
    transform = passes.T_earlier_later
    other = passes.later.sweep.points @ transform[:3, :3].T + transform[:3, 3]
    return passes.earlier.sweep.points, other


def seen(landmarks: Landmarks, points: Array, others: Array) -> Array:
    """(l,) bool: whether another pass saw what is there, so that it could have found it.

    points (n, 3), others (m, 3): of the two passes, in one frame. Half of a landmark's points have
    one of the other pass nearby, and it has there as many points as a landmark needs.
    """
    rows = np.flatnonzero(landmarks.point_labels >= 0)
    owner, count = landmarks.point_labels[rows], len(landmarks)
    if not len(rows):
        return np.zeros(count, bool)
    near = np.isfinite(cKDTree(others).query(points[rows], distance_upper_bound=CLOSE)[0])
    of_all = np.bincount(owner, minlength=count)
    share = np.bincount(owner, near, count) / np.maximum(1, of_all)
    distance, which = cKDTree(points[rows]).query(others, distance_upper_bound=CLOSE)
    there = np.bincount(owner[which[np.isfinite(distance)]], minlength=count)
    return np.asarray((share >= SHARE) & (there >= np.minimum(of_all, LEAST)))


def scores(passes: TwoPasses, here: Landmarks, later: Landmarks) -> dict[str, Any]:
    """Numbers of landmarks, and of those found again, by kind; both passes asked.

    Of more than MOST landmarks of a pass, every so many-th is asked for.
    """
    (cloud, other), there = _clouds(passes), moved(later, passes.T_earlier_later)
    rows = [np.arange(0, len(one), max(1, len(one) // MOST)) for one in (here, there)]
    lots = [
        (here.kind[rows[0]], found_again(here, there, rows[0]), seen(here, cloud, other)[rows[0]]),
        (
            there.kind[rows[1]],
            found_again(there, here, rows[1]),
            seen(there, other, cloud)[rows[1]],
        ),
    ]
    return {
        "landmarks": [len(here), len(there)],
        "asked": {"all": _tally(lots, list(Kind))}
        | {kind.name.lower(): _tally(lots, [kind]) for kind in Kind},
    }


def found_again(landmarks: Landmarks, others: Landmarks, rows: Array) -> Array:
    """(r,) bool: whether the landmarks `rows` agree with any of the others."""
    found = [
        np.isin(np.arange(len(part)), agreeing(select_landmarks(landmarks, part), others).earlier)
        for part in np.array_split(rows, -(-len(rows) // AT_ONCE))
        if len(part)
    ]
    return np.concatenate([np.zeros(0, bool), *found])


def _tally(lots: list[Any], kinds: list[Kind]) -> dict[str, int]:
    """Landmarks of some kinds: all, found again, seen by the other pass, both."""
    total = {"landmarks": 0, "again": 0, "seen": 0, "seen_again": 0}
    for kind, again, seen_there in lots:
        ours = np.isin(kind, kinds)
        total["landmarks"] += int(ours.sum())
        total["again"] += int((ours & again).sum())
        total["seen"] += int((ours & seen_there).sum())
        total["seen_again"] += int((ours & seen_there & again).sum())
    return total


def errors(what: Truth) -> dict[str, list[float]]:
    """Normalised errors squared of the pairs that agree, by kind.

    The squared Mahalanobis distance of a pair by the number of what is determined: 1 on average if
    the covariances are right.
    """
    later = moved(what.later, what.T_earlier_later)
    pairs = Pairs(*np.nonzero(what.same))
    covariance = later.covariance[pairs.later] + transported(what.earlier, later, pairs)
    kind = later.kind[pairs.later]
    error = innovations(
        kind,
        (what.earlier.position[pairs.earlier], what.earlier.axes[pairs.earlier]),
        (later.position[pairs.later], later.axes[pairs.later]),
    )
    squared = normalised_squares(kind, error, covariance)
    return {k.name.lower(): [round(float(s), 3) for s in squared[kind == k]] for k in Kind}


def transported(earlier: Landmarks, later: Landmarks, pairs: Pairs) -> Array:
    """Covariances (p, 6, 6) of earlier landmarks, as motions in the axes of the later ones.

    A turn about one place moves another: offsets far from where they are known are known less.
    """
    a, b = pairs
    turn = np.einsum("pji,pjk->pik", later.axes[b], earlier.axes[a])
    arm = np.einsum("pji,pj->pi", later.axes[b], later.position[b] - earlier.position[a])
    cross = np.zeros((len(a), 3, 3))  # arm x
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = -arm[:, 2], arm[:, 1], -arm[:, 0]
    cross -= cross.transpose(0, 2, 1)
    jacobian = np.zeros((len(a), 6, 6))
    jacobian[:, :3, :3] = jacobian[:, 3:, 3:] = turn
    jacobian[:, :3, 3:] = -cross @ turn
    found: Array = jacobian @ earlier.covariance[a] @ jacobian.transpose(0, 2, 1)
    return found
