"""Which landmark of one pass truly is which of another: they agree in what is determined."""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from ellipseg_ros.records import Array, Kind, Landmarks

PLANE_OFFSET, PLANE_ANGLE = 0.05, math.radians(1.5)  # m, rad
LINE_OFFSET, LINE_ANGLE = 0.10, math.radians(3.0)
BLOB_OFFSET = 0.3
CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])


class Pairs(NamedTuple):
    """Rows of two sets of landmarks."""

    earlier: Array  # (p,) int64
    later: Array  # (p,) int64


def moved(landmarks: Landmarks, transform: Array) -> Landmarks:
    """The same landmarks in another frame; transform (4, 4), rigid."""
    turn = transform[:3, :3]
    return replace(
        landmarks,
        position=landmarks.position @ turn.T + transform[:3, 3],
        axes=turn @ landmarks.axes,
    )


def agreeing(earlier: Landmarks, later: Landmarks) -> Pairs:
    """All pairs of one kind, in one frame, that agree in what their shape determines.

    Planes: where their boxes overlap, the offsets differ by at most 5 cm and the normals by
    1.5 degrees; lines: likewise, 10 cm and 3 degrees; blobs: 0.3 m between the centres.
    """
    pairs = _near(earlier, later)
    alike = earlier.kind[pairs.earlier] == later.kind[pairs.later]
    pairs = Pairs(pairs.earlier[alike], pairs.later[alike])
    kind = earlier.kind[pairs.earlier]
    apart, angle, overlap = _differences(earlier, later, pairs)
    good = (kind == Kind.PLANE) & (apart <= PLANE_OFFSET) & (angle <= PLANE_ANGLE)
    good |= (kind == Kind.LINE) & (apart <= LINE_OFFSET) & (angle <= LINE_ANGLE)
    good = (good & overlap) | ((kind == Kind.BLOB) & (apart <= BLOB_OFFSET))
    return Pairs(pairs.earlier[good], pairs.later[good])


def matrix(pairs: Pairs, earlier: int, later: int) -> Array:
    """Pairs as (earlier, later) bool."""
    same = np.zeros((earlier, later), bool)
    same[pairs.earlier, pairs.later] = True
    return same


def _near(earlier: Landmarks, later: Landmarks) -> Pairs:
    """All pairs whose boxes may overlap: the balls around them do."""
    if not len(earlier) or not len(later):
        return Pairs(np.zeros(0, np.int64), np.zeros(0, np.int64))
    reach = [
        np.linalg.norm(np.maximum(-one.box_min, one.box_max), axis=1) for one in (earlier, later)
    ]
    wide = BLOB_OFFSET + reach[0] + np.quantile(reach[1], 0.95)
    small = np.flatnonzero(reach[1] <= np.quantile(reach[1], 0.95))
    lists = cKDTree(later.position[small]).query_ball_point(earlier.position, wide)
    found = [small[np.array(rows, np.int64)] for rows in lists]
    large = np.setdiff1d(np.arange(len(later)), small)
    rows = [np.sort(np.concatenate([one, large])) for one in found]
    counts = [len(one) for one in rows]
    return Pairs(np.repeat(np.arange(len(earlier)), counts), np.concatenate(rows))


def _differences(earlier: Landmarks, later: Landmarks, pairs: Pairs) -> tuple[Array, Array, Array]:
    """Distance, m, and angle, rad, in what is determined, and whether the boxes overlap."""
    a, b = pairs
    low, high = _box_in(later, b, earlier.position[a], earlier.axes[a])
    low, high = np.maximum(low, earlier.box_min[a]), np.minimum(high, earlier.box_max[a])
    middle, kind = 0.5 * (low + high), earlier.kind[a]
    plane, line = kind == Kind.PLANE, kind == Kind.LINE
    middle[plane, 2] = 0.0
    middle[line, 1:] = 0.0
    free = high >= low
    overlap = np.where(plane, free[:, 0] & free[:, 1], free[:, 0])
    at = earlier.position[a] + np.einsum("pij,pj->pi", earlier.axes[a], middle)
    pole = np.where(plane, 2, 0)
    rows = np.arange(len(a))
    ours, theirs = earlier.axes[a][rows, :, pole], later.axes[b][rows, :, pole]
    angle = np.arcsin(np.minimum(1.0, np.linalg.norm(np.cross(ours, theirs), axis=1)))
    offset = at - later.position[b]
    along = np.sum(offset * theirs, axis=1)
    aside = np.linalg.norm(offset - along[:, None] * theirs, axis=1)
    centres = np.linalg.norm(earlier.position[a] - later.position[b], axis=1)
    apart = np.where(plane, np.abs(along), np.where(line, aside, centres))
    return apart, angle, overlap


def _box_in(landmarks: Landmarks, rows: Array, origin: Array, axes: Array) -> tuple[Array, Array]:
    """The boxes of landmarks, along other axes (p, 3, 3) and from other origins (p, 3)."""
    low, high = landmarks.box_min[rows], landmarks.box_max[rows]
    corners = low[:, None, :] + CORNERS[None] * (high - low)[:, None, :]
    world = np.einsum("pij,pcj->pci", landmarks.axes[rows], corners)
    world += (landmarks.position[rows] - origin)[:, None, :]
    local = np.einsum("pij,pci->pcj", axes, world)
    return local.min(axis=1), local.max(axis=1)
