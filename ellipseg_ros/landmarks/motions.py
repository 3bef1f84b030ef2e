"""How far apart two landmarks are in what their shape determines."""

import numpy as np

from ellipseg_ros.records import DETERMINED, Array, Kind

LEAST = 1e-18  # m^2, rad^2: nothing is measured better
ROUNDING = 1e-12  # of a covariance, by its trace


def motions(kind: Array, before: tuple[Array, Array], now: tuple[Array, Array]) -> Array:
    """Motions (l, 6) that bring landmarks from where they were to where they are; see DETERMINED.

    kind (l,); before, now: positions (l, 3) m and axes (l, 3, 3). In the axes of now, at its
    position, m and rad, for small angles; 0 where the shape determines nothing.
    """
    shift = now[0] - before[0]
    found = np.zeros((len(kind), 6))
    for which in Kind:
        rows = np.flatnonzero(kind == which)
        if which == Kind.BLOB:
            moved, turned = shift[rows], np.zeros((len(rows), 3))
        else:
            pole = 2 if which == Kind.PLANE else 0  # the axis that is a direction of the thing
            old, new = before[1][rows, :, pole], now[1][rows, :, pole]
            old = old * np.where(np.sum(old * new, axis=1) < 0.0, -1.0, 1.0)[:, None]
            turned = np.cross(old, new)
            along = np.sum(shift[rows] * old, axis=1)[:, None] * old
            moved = along if which == Kind.PLANE else shift[rows] - along
        local = [np.einsum("lij,li->lj", now[1][rows], part) for part in (moved, turned)]
        wanted = list(DETERMINED[which])
        found[np.ix_(rows, wanted)] = np.hstack(local)[:, wanted]
    return found


def normalised(kind: Array, motion: Array, covariance: Array) -> Array:
    """Squared Mahalanobis lengths (l,) of motions (l, 6), by the number of those determined.

    Its mean is 1 if the covariances (l, 6, 6) are right. A singular one counts as a little larger.
    """
    found = np.zeros(len(kind))
    for which, motions_of in DETERMINED.items():
        rows, wanted = np.flatnonzero(kind == which), list(motions_of)
        part = motion[np.ix_(rows, wanted)]
        inner = covariance[np.ix_(rows, wanted, wanted)]
        _widen(inner)
        solved = np.linalg.solve(inner, part[:, :, None])[:, :, 0] if len(rows) else part
        found[rows] = np.sum(part * solved, axis=1) / len(wanted)
    return found


def _widen(covariance: Array) -> None:
    """Add a little to those (l, d, d) that have no inverse; leave the others as they are."""
    singular = np.linalg.det(covariance) == 0.0
    size = np.trace(covariance[singular], axis1=1, axis2=2)
    more = LEAST + ROUNDING * size
    covariance[singular] += more[:, None, None] * np.eye(covariance.shape[1])
