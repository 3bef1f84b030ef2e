"""True correspondences between the landmarks of two drives, by geometry alone."""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from ellipseg_ros.records import Array, Kind, Landmarks

MAX_DIFFERENCE = {  # m, rad, in what the shape of a landmark determines
    Kind.PLANE: (0.05, math.radians(1.5)),
    Kind.LINE: (0.10, math.radians(3.0)),
    Kind.BLOB: (0.3, math.inf),
}
LARGE_QUANTILE = 0.95  # landmarks larger than this are compared with all others
CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])


class Pairs(NamedTuple):
    """Pairs of landmarks of two sets, by row."""

    earlier: Array  # (p,) int64
    later: Array  # (p,) int64

    def matrix(self, earlier: int, later: int) -> Array:
        """The pairs as (earlier, later) bool, for sets of these sizes."""
        matrix = np.zeros((earlier, later), bool)
        matrix[self.earlier, self.later] = True
        return matrix


class Differences(NamedTuple):
    """Differences of paired landmarks in what their shape determines."""

    offset: Array  # (p,) m
    angle: Array  # (p,) rad
    overlap: Array  # (p,) bool: the boxes overlap along the plane or line


def transformed(landmarks: Landmarks, transform: Array) -> Landmarks:
    """The landmarks in another frame; transform (4, 4), rigid. Covariances are local."""
    rotation = transform[:3, :3]
    return replace(
        landmarks,
        position=landmarks.position @ rotation.T + transform[:3, 3],
        axes=rotation @ landmarks.axes,
    )


def agreeing_pairs(earlier: Landmarks, later: Landmarks) -> Pairs:
    """All pairs of one kind, in one frame, within MAX_DIFFERENCE and with overlapping boxes."""
    pairs = _overlapping_balls(earlier, later)
    alike = earlier.kind[pairs.earlier] == later.kind[pairs.later]
    pairs = Pairs(pairs.earlier[alike], pairs.later[alike])
    kind = earlier.kind[pairs.earlier]
    difference = _differences(earlier, later, pairs)
    agree = np.zeros(len(kind), bool)
    for which, (offset, angle) in MAX_DIFFERENCE.items():
        within = (difference.offset <= offset) & (difference.angle <= angle)
        agree |= (kind == which) & within & (difference.overlap | (which == Kind.BLOB))
    return Pairs(pairs.earlier[agree], pairs.later[agree])


def _overlapping_balls(earlier: Landmarks, later: Landmarks) -> Pairs:
    """A superset of the pairs with overlapping boxes, by the balls around them."""
    if not len(earlier) or not len(later):
        return Pairs(np.zeros(0, np.int64), np.zeros(0, np.int64))
    radii = [
        np.linalg.norm(np.maximum(-one.box_min, one.box_max), axis=1) for one in (earlier, later)
    ]
    limit = np.quantile(radii[1], LARGE_QUANTILE)
    small, large = np.flatnonzero(radii[1] <= limit), np.flatnonzero(radii[1] > limit)
    reach = MAX_DIFFERENCE[Kind.BLOB][0] + radii[0] + limit
    near = cKDTree(later.position[small]).query_ball_point(earlier.position, reach)
    rows = [np.sort(np.concatenate([small[np.array(r, np.int64)], large])) for r in near]
    counts = [len(row) for row in rows]
    return Pairs(np.repeat(np.arange(len(earlier)), counts), np.concatenate(rows))


def _differences(earlier: Landmarks, later: Landmarks, pairs: Pairs) -> Differences:
    """Differences at the middle of the overlap of the boxes."""
    a, b = pairs
    low, high = _box_in_axes(later, b, earlier.position[a], earlier.axes[a])
    low, high = np.maximum(low, earlier.box_min[a]), np.minimum(high, earlier.box_max[a])
    middle, kind = 0.5 * (low + high), earlier.kind[a]
    plane, line = kind == Kind.PLANE, kind == Kind.LINE
    middle[plane, 2] = 0.0
    middle[line, 1:] = 0.0
    overlaps = high >= low
    overlap = np.where(plane, overlaps[:, 0] & overlaps[:, 1], overlaps[:, 0])
    place = earlier.position[a] + np.einsum("pij,pj->pi", earlier.axes[a], middle)
    pole = np.where(plane, 2, 0)
    rows = np.arange(len(a))
    pole_a, pole_b = earlier.axes[a][rows, :, pole], later.axes[b][rows, :, pole]
    angle = np.arcsin(np.minimum(1.0, np.linalg.norm(np.cross(pole_a, pole_b), axis=1)))
    offset = place - later.position[b]
    along = np.sum(offset * pole_b, axis=1)
    across = np.linalg.norm(offset - along[:, None] * pole_b, axis=1)
    centres = np.linalg.norm(earlier.position[a] - later.position[b], axis=1)
    distance = np.where(plane, np.abs(along), np.where(line, across, centres))
    return Differences(distance, angle, overlap)


def _box_in_axes(
    landmarks: Landmarks, rows: Array, origin: Array, axes: Array
) -> tuple[Array, Array]:
    """Boxes around those of landmarks, from origins (p, 3) along axes (p, 3, 3): low and high."""
    low, high = landmarks.box_min[rows], landmarks.box_max[rows]
    corners = low[:, None, :] + CORNERS[None] * (high - low)[:, None, :]
    world = np.einsum("pij,pcj->pci", landmarks.axes[rows], corners)
    world += (landmarks.position[rows] - origin)[:, None, :]
    local = np.einsum("pij,pci->pcj", axes, world)
    return local.min(axis=1), local.max(axis=1)
