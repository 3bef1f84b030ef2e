"""Plane landmarks: whole flat surfaces, composed of the flat tiles that segments are."""

import math
from typing import NamedTuple

import numpy as np

from ellipseg_ros.config import LandmarksConfig
from ellipseg_ros.core.jit import for_parts, kernel
from ellipseg_ros.core.linalg.vectors import combined, difference, dot, row
from ellipseg_ros.core.members import Boxes, group_boxes, group_members, groups_of_points
from ellipseg_ros.core.moments import add_products, shape, unite, united
from ellipseg_ros.landmarks.fits import (
    CHUNKS,
    Fits,
    add_observation,
    add_to_box,
    count_passes,
    fit_covariance,
    renumber,
    set_moments,
)
from ellipseg_ros.objects.agglomeration import flat_groups
from ellipseg_ros.records import Array, SegmentAdjacency

# A part is a group of segments that are flat together; a plane consists of coplanar parts.
MIN_PART_SIGMA = 0.2  # m: smallest standard deviation along a part
MIN_BROAD_SIGMA = 0.3  # m: along a part whose segments are searched for no lines and blobs
MAX_PART_FLATNESS = 0.3  # thickness by width of a part
MAX_OFFSET = 0.05  # m: from the middle of a part to the plane that it joins
OFFSET_FACTOR = 4.0  # times that, the other way round: the normal of the smaller part is less sure
MIN_COSINE = math.cos(math.radians(4.0))  # between the normals of coplanar parts
MAX_GAP = 2.0  # m between the boxes of coplanar parts
MIN_SIGMA = 0.5  # m: smallest standard deviation along a plane
MAX_FLATNESS = 0.03  # thickness by width of a plane: a rough one must be wider
SYSTEMATIC = 0.2  # share of the roughness that is no noise: another part of it leans otherwise
ROUNDS = 4  # of fitting and rejecting points
CUT_SIGMAS = 2.5  # standard deviations from the plane within which a point belongs to it


class Planes(NamedTuple):
    """Planes, and what belongs to them."""

    fits: Fits
    point_labels: Array  # (n,) int32: the plane of every point, -1 for none
    broad: Array  # (s,) bool: segments of broad flat things, landmarks or not


def find_planes(
    points: Array,
    labels: Array,
    segments: Array,
    adjacency: SegmentAdjacency,
    config: LandmarksConfig,
) -> Planes:
    """Plane landmarks of a window.

    points (n, 3) m, local origin; labels (n,) int32, the segments, negative for none; segments
    (s,): moments of their points.
    Adjacent segments that are flat together form parts; coplanar parts near one another form a
    plane. A rough surface must be wide to be a plane: else it is a tile of something round.
    """
    group = flat_groups(segments, adjacency, config.roughness)
    moments = united(segments, group, int(group.max(initial=-1)) + 1)
    sigma = np.sqrt(moments["eigenvalues"])  # ascending
    flat = (sigma[:, 1] >= MIN_PART_SIGMA) & (sigma[:, 0] < MAX_PART_FLATNESS * sigma[:, 1])
    flat &= moments["count"] >= config.min_points
    parts = np.flatnonzero(flat)
    parts = parts[np.argsort(-moments["count"][parts], kind="stable")]
    plane_of_group = np.full(len(moments) + 1, -1, np.int32)
    around = group_boxes(points, groups_of_points(labels, group), len(moments))
    plane_of_group[parts] = join_coplanar(moments[parts], Boxes(*(b[parts] for b in around)))
    of_segment = plane_of_group[group]

    count = int(of_segment.max(initial=-1)) + 1
    members = group_members(groups_of_points(labels, of_segment), count)
    whole = united(moments[parts], plane_of_group[parts], count)
    fits, kept = Fits.empty(count), np.zeros(len(members.rows), bool)
    for_parts([(p, p + 1) for p in range(count)], _fit, points, members, whole, fits, kept)
    good = (fits.sigma[:, 1] >= MIN_SIGMA) & (fits.count >= config.min_points)
    good &= fits.sigma[:, 2] < MAX_FLATNESS * fits.sigma[:, 1]
    point_labels = np.full(len(points), -1, np.int32)
    plane = np.repeat(np.arange(count, dtype=np.int32), np.diff(members.starts))
    point_labels[members.rows[kept]] = plane[kept]
    broad = (of_segment >= 0) & (sigma[group, 1] >= MIN_BROAD_SIGMA)
    return Planes(fits.select(good), renumber(point_labels, good), broad)


def join_coplanar(moments: Array, around: Boxes) -> Array:
    """The plane (c,) int32 of every flat part, numbered by the largest part.

    moments (c,), descending by count; around: their boxes. A plane takes in one part after the
    other, and each extends its reach.
    """
    plane = np.arange(len(moments), dtype=np.int32)
    _join_coplanar(moments.copy(), around.low.copy(), around.high.copy(), plane)
    return np.unique(plane, return_inverse=True)[1].astype(np.int32).reshape(-1)


@kernel
def _join_coplanar(moments, low, high, plane):
    for a in range(len(plane)):
        grown = plane[a] == a
        while grown:
            grown = False
            for b in range(a + 1, len(plane)):
                near = plane[b] == b and _gap(low, high, a, b) <= MAX_GAP
                if near and _coplanar(moments[a], moments[b]):
                    plane[b] = a
                    unite(moments, a, b, a)
                    for axis in range(3):
                        low[a, axis] = min(low[a, axis], low[b, axis])
                        high[a, axis] = max(high[a, axis], high[b, axis])
                    grown = True


@kernel
def _coplanar(a, b):
    """Whether b, the moments of the smaller part, lies in the plane of a."""
    between = difference(b["mean"], a["mean"])
    near = abs(dot(a.v3, between)) <= MAX_OFFSET
    near = near and abs(dot(b.v3, between)) <= OFFSET_FACTOR * MAX_OFFSET
    return near and abs(dot(a.v3, b.v3)) >= MIN_COSINE


@kernel
def _gap(low, high, a, b):
    """Distance of two boxes."""
    squared = 0.0
    for axis in range(3):
        gap = max(0.0, low[b, axis] - high[a, axis], low[a, axis] - high[b, axis])
        squared += gap * gap
    return math.sqrt(squared)


@kernel
def _fit(p, _, points, members, whole, fits, kept):
    """Fit plane p to its points, without those beyond CUT_SIGMAS standard deviations."""
    begin, end = members.starts[p], members.starts[p + 1]
    moments = whole[p : p + 1].copy()
    for _round in range(ROUNDS):
        _refit(points, members.rows[begin:end], moments, kept[begin:end])
    set_moments(moments, 0, fits, p)
    fits.roughness[p] = fits.sigma[p, 2]
    rows = members.rows[begin:end][kept[begin:end]]
    fits.count[p], fits.passes[p] = len(rows), count_passes(rows)
    _set_covariance(points, rows, fits, p)


@kernel
def _refit(points, rows, moments, kept):
    """Replace the moments of a plane, in row 0, by those of the points near it."""
    m = moments[0]
    centre, normal = (m.mean_x, m.mean_y, m.mean_z), (m.v3_x, m.v3_y, m.v3_z)
    cut = CUT_SIGMAS * math.sqrt(m.e3)
    count, total = 0, (0.0, 0.0, 0.0)
    m["covariance"][:] = 0.0
    for k in range(len(rows)):
        offset = difference(row(points, rows[k]), centre)
        kept[k] = abs(dot(normal, offset)) <= cut
        if kept[k]:
            count += 1
            total = combined(total, 1.0, offset)
            add_products(m, offset)
    mx, my, mz = total[0] / count, total[1] / count, total[2] / count
    m.mean_x, m.mean_y, m.mean_z = combined(centre, 1.0, (mx, my, mz))
    m.xx, m.xy, m.xz = m.xx / count - mx * mx, m.xy / count - mx * my, m.xz / count - mx * mz
    m.yy, m.yz, m.zz = m.yy / count - my * my, m.yz / count - my * mz, m.zz / count - mz * mz
    shape(moments, 0)


@kernel
def _set_covariance(points, rows, fits, p):
    """Set box and covariance of a plane. Motions: along z, about x, about y."""
    matrix, scores = np.zeros((3, 3)), np.zeros((CHUNKS, 3))
    motion, local = np.ones(3), np.empty(3)
    for k in range(len(rows)):
        add_to_box(points, rows[k], fits, p, local)
        motion[1], motion[2] = local[1], -local[0]
        add_observation(motion, local[2], matrix, scores[k * CHUNKS // len(rows)])
    roughness = fits.roughness[p]
    fits.covariance[p, 2:5, 2:5] = fit_covariance(matrix, scores, roughness * roughness)
    fits.covariance[p, 3, 3] += (SYSTEMATIC * fits.sigma[p, 2] / fits.sigma[p, 1]) ** 2
    fits.covariance[p, 4, 4] += (SYSTEMATIC * fits.sigma[p, 2] / fits.sigma[p, 0]) ** 2
