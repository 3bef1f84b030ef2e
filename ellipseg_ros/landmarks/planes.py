"""Planes that can be found again: whole flat surfaces, not the tiles that segments are."""

import math
from typing import NamedTuple

import numpy as np

from ellipseg_ros.config import LandmarksConfig
from ellipseg_ros.core.flat_moments import (
    COUNT,
    COVARIANCE,
    EIGENVALUES,
    MEAN,
    V1,
    V2,
    V3,
    set_axes,
    unite,
    united,
)
from ellipseg_ros.core.jit import for_parts, kernel
from ellipseg_ros.core.members import Boxes, Members, boxes, members
from ellipseg_ros.landmarks.fits import CHUNKS, Fits, chosen, no_fits, passages, uncertainty
from ellipseg_ros.objects.agglomeration import flat_groups
from ellipseg_ros.records import Array, SegmentAdjacency

NARROWEST = 0.5  # m: least standard deviation along a plane,
PART = 0.2  # m: and along a part of one
FLAT = 0.3  # thickness by width from which on a part is not flat,
THIN = 0.03  # and a whole is no plane: what is crooked must be the wider
NEAR = 0.05  # m: from the middle of a part to the plane of another, if they are one plane
PARALLEL = math.cos(math.radians(4.0))  # of their normals
GAP = 2.0  # m between their boxes
CROOKED = 0.2  # share of the roughness that is not noise: another part of it leans otherwise
ROUNDS = 4
CUT = 2.5  # standard deviations from the plane within which a point belongs to it


class Planes(NamedTuple):
    """Planes and what they are made of."""

    fits: Fits
    points: Members  # of each
    flat: Array  # (s,) bool: segments of broad flat things, landmarks or not


def find_planes(
    points: Array, labels: Array, own: Array, adjacency: SegmentAdjacency, config: LandmarksConfig
) -> Planes:
    """The flat surfaces of a window.

    points (n, 3) m, local origin; labels (n,) int32, the segments, negative for none; own (s, 24).
    What is flat together grows together; parts that lie in one plane near one another are one.
    What is crooked must be the wider to be a plane: else it is a tile of something round.
    """
    group = flat_groups(own, adjacency, config.roughness)
    nodes = united(own, group, int(group.max(initial=-1)) + 1)
    sigma = np.sqrt(nodes[:, EIGENVALUES : EIGENVALUES + 3])  # ascending
    flat = (sigma[:, 1] >= PART) & (sigma[:, 0] < FLAT * sigma[:, 1])
    flat &= nodes[:, COUNT] >= config.min_points
    parts = np.flatnonzero(flat)
    parts = parts[np.argsort(-nodes[parts, COUNT], kind="stable")]
    plane_of_group = np.full(len(nodes) + 1, -1, np.int32)
    around = boxes(points, labels, group, len(nodes))
    plane_of_group[parts] = join_coplanar(nodes[parts], Boxes(*(b[parts] for b in around)))
    of_segment = plane_of_group[group]

    count = int(of_segment.max(initial=-1)) + 1
    inside = members(labels, of_segment, count)
    whole = united(nodes[parts], plane_of_group[parts], count)
    fits = no_fits(count)
    kept = np.zeros(len(inside.rows), bool)
    for_parts([(p, p + 1) for p in range(count)], _fit, points, inside, whole, fits, kept)
    good = (fits.sigma[:, 1] >= NARROWEST) & (fits.count >= config.min_points)
    good &= fits.sigma[:, 2] < THIN * fits.sigma[:, 1]
    broad = (of_segment >= 0) & (sigma[group, 1] >= 1.5 * PART)
    return Planes(chosen(fits, good), _kept(inside, kept, good), broad)


def _kept(inside: Members, kept: Array, good: Array) -> Members:
    """The points that the good planes have kept."""
    plane = np.repeat(np.arange(len(good)), np.diff(inside.starts))
    stays = kept & good[plane]
    counts = np.bincount(plane[stays], minlength=len(good))[good]
    return Members(np.append(0, np.cumsum(counts)), inside.rows[stays])


def join_coplanar(nodes: Array, around: Boxes) -> Array:
    """The plane (c,) int32 of every flat part, numbered by the largest part.

    nodes (c, 24), descending by count; around: their boxes. A plane takes in one part after the
    other, and each lets it reach farther.
    """
    above = np.arange(len(nodes), dtype=np.int32)
    _join_coplanar(nodes.copy(), around.low.copy(), around.high.copy(), above)
    return np.unique(above, return_inverse=True)[1].astype(np.int32).reshape(-1)


@kernel
def _join_coplanar(nodes, low, high, above):
    for a in range(len(above)):
        again = above[a] == a
        while again:
            again = False
            for b in range(a + 1, len(above)):
                if above[b] == b and _gap(low, high, a, b) <= GAP and _coplanar(nodes, a, b):
                    above[b] = a
                    unite(nodes, a, b, a)
                    for axis in range(3):
                        low[a, axis] = min(low[a, axis], low[b, axis])
                        high[a, axis] = max(high[a, axis], high[b, axis])
                    again = True


@kernel
def _coplanar(nodes, a, b):
    """Whether b lies in the plane of a; the plane of b, the smaller one, is known less well."""
    cosine = from_a = from_b = 0.0
    for axis in range(3):
        between = nodes[b, MEAN + axis] - nodes[a, MEAN + axis]
        cosine += nodes[a, V3 + axis] * nodes[b, V3 + axis]
        from_a += nodes[a, V3 + axis] * between
        from_b += nodes[b, V3 + axis] * between
    return abs(cosine) >= PARALLEL and abs(from_a) <= NEAR and abs(from_b) <= 4.0 * NEAR


@kernel
def _gap(low, high, a, b):
    squared = 0.0
    for axis in range(3):
        gap = max(0.0, low[b, axis] - high[a, axis], low[a, axis] - high[b, axis])
        squared += gap * gap
    return math.sqrt(squared)


@kernel
def _fit(p, _, points, inside, whole, fits, kept):
    """Fit plane p to its points, but those beyond CUT standard deviations."""
    begin, end = inside.starts[p], inside.starts[p + 1]
    rows = inside.rows[begin:end]
    node = whole[p : p + 1].copy()
    for _round in range(ROUNDS):
        _moments(points, rows, node, kept[begin:end])
    sigma = np.sqrt(node[0, EIGENVALUES : EIGENVALUES + 3])
    fits.roughness[p] = sigma[0]
    for k in range(3):
        fits.position[p, k] = node[0, MEAN + k]
        fits.sigma[p, k] = sigma[2 - k]
        fits.axes[p, k, 0] = node[0, V1 + k]
        fits.axes[p, k, 1] = node[0, V2 + k]
        fits.axes[p, k, 2] = node[0, V3 + k]
    mine = rows[kept[begin:end]]
    fits.count[p], fits.passages[p] = len(mine), passages(mine)
    _spread(points, mine, fits, p)


@kernel
def _moments(points, rows, node, kept):
    """Mean, covariance and axes of the points near the plane of the node, which they replace."""
    px, py, pz = node[0, MEAN], node[0, MEAN + 1], node[0, MEAN + 2]
    nx, ny, nz = node[0, V3], node[0, V3 + 1], node[0, V3 + 2]
    cut = CUT * math.sqrt(node[0, EIGENVALUES])
    count = 0
    mx = my = mz = xx = xy = xz = yy = yz = zz = 0.0
    for k in range(len(rows)):
        i = rows[k]
        dx, dy, dz = points[i, 0] - px, points[i, 1] - py, points[i, 2] - pz
        kept[k] = abs(nx * dx + ny * dy + nz * dz) <= cut
        if kept[k]:
            count += 1
            mx += dx
            my += dy
            mz += dz
            xx += dx * dx
            xy += dx * dy
            xz += dx * dz
            yy += dy * dy
            yz += dy * dz
            zz += dz * dz
    mx, my, mz = mx / count, my / count, mz / count
    node[0, MEAN], node[0, MEAN + 1], node[0, MEAN + 2] = px + mx, py + my, pz + mz
    node[0, COVARIANCE] = xx / count - mx * mx
    node[0, COVARIANCE + 1] = xy / count - mx * my
    node[0, COVARIANCE + 2] = xz / count - mx * mz
    node[0, COVARIANCE + 3] = yy / count - my * my
    node[0, COVARIANCE + 4] = yz / count - my * mz
    node[0, COVARIANCE + 5] = zz / count - mz * mz
    set_axes(node, 0)


@kernel
def _spread(points, rows, fits, p):
    """Box and covariance of a plane. Motions: along z, about x, about y."""
    matrix, scores = np.zeros((3, 3)), np.zeros((CHUNKS, 3))
    motion = np.empty(3)
    place = np.empty(3)
    for axis in range(3):
        fits.low[p, axis], fits.high[p, axis] = np.inf, -np.inf
    for k in range(len(rows)):
        for axis in range(3):
            place[axis] = 0.0
            for c in range(3):
                place[axis] += fits.axes[p, c, axis] * (points[rows[k], c] - fits.position[p, c])
            fits.low[p, axis] = min(fits.low[p, axis], place[axis])
            fits.high[p, axis] = max(fits.high[p, axis], place[axis])
        motion[0], motion[1], motion[2] = 1.0, place[1], -place[0]
        chunk = k * CHUNKS // len(rows)
        for m in range(3):
            scores[chunk, m] += motion[m] * place[2]
            for n in range(m + 1):
                matrix[m, n] += motion[m] * motion[n]
    found = uncertainty(matrix, scores, fits.roughness[p] * fits.roughness[p])
    for m in range(3):
        for n in range(3):
            fits.covariance[p, 2 + m, 2 + n] = found[m, n]
    fits.covariance[p, 3, 3] += (CROOKED * fits.sigma[p, 2] / fits.sigma[p, 1]) ** 2
    fits.covariance[p, 4, 4] += (CROOKED * fits.sigma[p, 2] / fits.sigma[p, 0]) ** 2
