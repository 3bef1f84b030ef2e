"""Innovation of landmarks between two observations, in the motions that their shape determines."""

import numpy as np

from ellipseg_ros.records import DETERMINED, Array, Kind

MIN_VARIANCE = 1e-18  # m^2, rad^2: nothing is measured better
ROUNDING = 1e-12  # added to a singular covariance, by its trace
DIRECTION = {Kind.PLANE: 2, Kind.LINE: 0}  # the axis that is the direction of a landmark


def innovations(kind: Array, before: tuple[Array, Array], now: tuple[Array, Array]) -> Array:
    """Motions (l, 6) of landmarks from their previous to their present place; see DETERMINED.

    kind (l,); before, now: positions (l, 3) m and axes (l, 3, 3). In the present axes, at the
    present position, m and rad, for small angles; 0 where the shape determines nothing.
    """
    shift = now[0] - before[0]
    result = np.zeros((len(kind), 6))
    for each, determined in DETERMINED.items():
        rows, motions = np.flatnonzero(kind == each), list(determined)
        moved, turned = shift[rows], np.zeros((len(rows), 3))
        if each in DIRECTION:
            old, new = before[1][rows, :, DIRECTION[each]], now[1][rows, :, DIRECTION[each]]
            old = old * np.where(np.sum(old * new, axis=1) < 0.0, -1.0, 1.0)[:, None]
            turned = np.cross(old, new)
            along = np.sum(moved * old, axis=1)[:, None] * old
            moved = along if each == Kind.PLANE else moved - along
        local = [np.einsum("lij,li->lj", now[1][rows], part) for part in (moved, turned)]
        result[np.ix_(rows, motions)] = np.hstack(local)[:, motions]
    return result


def normalised_squares(kind: Array, innovation: Array, covariance: Array) -> Array:
    """Normalised innovation squared (l,): squared Mahalanobis distances by degrees of freedom.

    innovation (l, 6); covariance (l, 6, 6), a singular one is slightly enlarged. The mean is 1 if
    the covariances are right.
    """
    result = np.zeros(len(kind))
    for each, determined in DETERMINED.items():
        rows, motions = np.flatnonzero(kind == each), list(determined)
        part = innovation[np.ix_(rows, motions)]
        inner = _regular(covariance[np.ix_(rows, motions, motions)])
        solution = np.linalg.solve(inner, part[:, :, None])[:, :, 0] if len(rows) else part
        result[rows] = np.sum(part * solution, axis=1) / len(motions)
    return result


def _regular(covariance: Array) -> Array:
    """The matrices (l, d, d), those that are singular slightly enlarged."""
    singular = np.linalg.det(covariance) == 0.0
    added = MIN_VARIANCE + ROUNDING * np.trace(covariance[singular], axis1=1, axis2=2)
    covariance[singular] += added[:, None, None] * np.eye(covariance.shape[1])
    return covariance
