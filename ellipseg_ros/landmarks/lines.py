"""Line landmarks: trunks, poles and pipes, as long round things with free space around them."""

import math
from typing import NamedTuple

import numpy as np

from ellipseg_ros.config import LandmarksConfig
from ellipseg_ros.core.jit import kernel
from ellipseg_ros.core.linalg.vectors import difference, dot, norm, row
from ellipseg_ros.core.members import Boxes, Members
from ellipseg_ros.landmarks.cylinder import (
    PARAMETERS,
    RADIUS,
    RADIUS_PRIOR,
    TAPER,
    TAPER_PRIOR,
    across,
    axial,
    fit_cylinder,
    residual,
)
from ellipseg_ros.landmarks.fits import (
    CHUNKS,
    Fits,
    add_observation,
    add_to_box,
    count_passes,
    fit_covariance,
    renumber,
)
from ellipseg_ros.landmarks.seed_axis import MIN_SEED_SIGMA, aim
from ellipseg_ros.records import Array

# Seeds: segments from which lines grow
MAX_SEED_SIGMA = 1000.0  # m: the largest; a stray point far away stretches a segment endlessly
MAX_SEED_WIDTH = 0.35  # m: largest standard deviation across a seed
MAX_SEED_ASPECT = 0.5  # width by length of a seed
SHEET_THICKNESS = 0.08  # m: a seed thinner than this, and wide, is a piece of ground or wall
MIN_POINTS = 12  # of a seed, and of a line
STRIP_THICKNESS = 0.03  # m: a thinner seed may be a strip of something round and wider
MAX_TAKEN = 0.3  # share of the points that other lines have, of a seed or a line

# Growth along the axis
ROUNDS = 6  # of collecting and fitting
BIN = 0.2  # m along the axis
REACH = 1.0  # m beyond the ends where points of the continuation are collected
NEAR_ACROSS, NEAR_ALONG = 2.0, 15.0  # m: segments this near to the first axis are considered
CLEARANCE = 0.25  # m: a tube of this width around the line must be free
MAX_AROUND = 0.5  # points in that tube, by points in the line: with more, a bin is crowded
MAX_HOLE = 4  # empty bins that do not end a line; a crowded one counts twice
TUBE_SIGMAS = 2.5  # radius of the line's tube beyond its own, in standard deviations
MIN_TUBE = 0.1  # m: smallest radius of the first tube
MIN_MARGIN = 0.03  # m: smallest distance of the tube from the fitted surface, to which
EXTRA_MARGIN = 0.02  # m are added, up to
MAX_MARGIN = 0.1  # m beyond the largest radius
END_SIGMAS = 1.8  # first ends, in standard deviations along the seed: sqrt(3) if it is uniform
RADIUS_SIGMAS = 1.4  # first radius, in RMS distances from the first axis
MAX_FIRST_RADIUS = 0.3  # m
MAX_SPREAD = 0.2  # m: largest standard deviation of the points from the surface

# Lines that are landmarks
MIN_RADIUS = 0.01  # m
MAX_RADIUS = 0.45  # m, protruding points included
MIN_LENGTH = 1.0  # m
MAX_TAPER = 0.1  # change of the radius along the line


class Lines(NamedTuple):
    """Lines, and what belongs to them."""

    fits: Fits
    point_labels: Array  # (n,) int32: the line of every point, -1 for none
    taken: Array  # (n,) bool: points of lines, landmarks or not


class Balls(NamedTuple):
    """Segments with balls around their points."""

    starts: Array  # (s + 1,) int64: points of every segment
    rows: Array
    centre: Array  # (s, 3) m
    radius: Array  # (s,) m


class Line(NamedTuple):
    """A line while it grows."""

    point: Array  # (3,) m, on the axis
    axis: Array  # (3,)
    fit: Array  # (PARAMETERS,), see cylinder.py
    ends: Array  # (2,) m along the axis from the point


def find_lines(
    points: Array,
    members: Members,
    moments: Array,
    around: Boxes,
    broad: Array,
    config: LandmarksConfig,
) -> Lines:
    """Line landmarks of a window.

    points (n, 3) m, local origin; members: the points of every segment; moments (s,):
    theirs; around: their boxes; broad (s,) bool: segments that are no part of lines.
    Long and thin segments are the seeds, the longest and largest first; all points near the axis
    decide where it lies and how far it extends: as long as the tube around it is free.
    """
    seeds = _seeds(moments, broad)
    centre, half = 0.5 * (around.low + around.high), 0.5 * (around.high - around.low)
    balls = Balls(*members, centre, np.linalg.norm(half, axis=1))
    fits, taper = Fits.empty(len(seeds)), np.zeros(len(seeds))
    point_labels = np.full(len(points), -1, np.int32)
    _find_all(points, balls, moments, seeds, fits, taper, point_labels)
    good = (fits.count >= config.min_points) & (2 * fits.passes >= config.min_points)
    good &= fits.box_max[:, 0] - fits.box_min[:, 0] >= MIN_LENGTH
    good &= (np.abs(taper) <= MAX_TAPER) & (fits.roughness <= config.roughness)
    return Lines(fits.select(good), renumber(point_labels, good), point_labels >= 0)


def _seeds(moments: Array, broad: Array) -> Array:
    """Segments from which lines may grow, in the order in which they are tried."""
    thickness, width, length = np.sqrt(moments["eigenvalues"]).T
    seeds = ~broad & ~((width > MIN_SEED_SIGMA) & (thickness < SHEET_THICKNESS))
    seeds &= (moments["count"] >= MIN_POINTS) & (length >= MIN_SEED_SIGMA)
    seeds &= (length <= MAX_SEED_SIGMA) & (width <= MAX_SEED_WIDTH)
    seeds &= width < MAX_SEED_ASPECT * length
    order = np.flatnonzero(seeds)
    return order[np.argsort(-moments["count"][order] * length[order], kind="stable")]


@kernel
def _find_all(points, balls, moments, seeds, fits, taper, point_labels):
    room = np.empty(len(points), np.int64)
    near = np.empty(len(balls.radius), np.int64)
    for which in range(len(seeds)):
        seed = seeds[which]
        if _taken(balls.rows[balls.starts[seed] : balls.starts[seed + 1]], point_labels):
            continue
        line = Line(np.empty(3), np.empty(3), np.zeros(PARAMETERS), np.zeros(2))
        count = _grow(points, balls, moments, seed, 0.0, near, room, line)
        strip = moments[seed].e3 < STRIP_THICKNESS * STRIP_THICKNESS
        if strip and (count < MIN_POINTS or line.ends[1] - line.ends[0] < MIN_LENGTH):
            count = _grow(points, balls, moments, seed, MAX_RADIUS, near, room, line)
        rows = room[:count]
        if count < MIN_POINTS or _taken(rows, point_labels):
            continue
        _orient(line)
        _measure(points, rows, line, fits, which)
        taper[which] = line.fit[TAPER]
        for i in rows:
            point_labels[i] = which


@kernel
def _taken(rows, point_labels):
    """Whether too many of the points are in other lines."""
    return np.count_nonzero(point_labels[rows] >= 0) > MAX_TAKEN * len(rows)


@kernel
def _grow(points, balls, moments, seed, tube, near, room, line):
    """Let a line grow from a seed; returns how many points, ascending, `room` holds of it.

    tube: smallest radius of the first tube, m.
    """
    point, axis, fit, ends = line
    point[:], axis[:] = moments[seed]["mean"], moments[seed].v1
    rows = balls.rows[balls.starts[seed] : balls.starts[seed + 1]]
    width = aim(points, rows, point, axis)
    inside = min(max(TUBE_SIGMAS * width, MIN_TUBE, tube), MAX_RADIUS)
    half = END_SIGMAS * math.sqrt(moments[seed].e1)
    ends[0], ends[1] = -half, half
    fit[RADIUS] = min(RADIUS_SIGMAS * width, MAX_FIRST_RADIUS)
    close = _near(balls, line, near)
    count, length = 0, -1.0
    for _round in range(ROUNDS):
        collected = _collect(points, balls, near[:close], line, inside + CLEARANCE, room)
        _find_ends(points, room[:collected], inside, line)
        count = _within(points, room[:collected], line, ends[0], ends[1], inside, room)
        if count < MIN_POINTS:
            return 0
        room[:count] = np.sort(room[:count])
        spread = fit_cylinder(points, room[:count], point, axis, fit)
        if not spread < MAX_SPREAD:
            return 0
        fit[RADIUS] = min(max(fit[RADIUS], MIN_RADIUS), MAX_RADIUS)
        inside = fit[RADIUS] + max(TUBE_SIGMAS * spread, MIN_MARGIN) + EXTRA_MARGIN
        inside = min(inside, MAX_RADIUS + MAX_MARGIN)
        _recentre(line)
        if abs(ends[1] - ends[0] - length) < 0.5 * BIN:
            break
        length = ends[1] - ends[0]
    return count


@kernel
def _near(balls, line, near):
    """Write the segments that may come near the line; returns how many."""
    count = 0
    for s in range(len(balls.radius)):
        radius = balls.radius[s]
        offset = difference(row(balls.centre, s), line.point)
        farthest = NEAR_ACROSS + NEAR_ALONG + radius
        if dot(offset, offset) > farthest * farthest:
            continue  # most of them
        along, aside = axial(balls.centre, s, line.point, line.axis)
        if aside <= NEAR_ACROSS + radius and abs(along) <= NEAR_ALONG + radius:
            near[count] = s
            count += 1
    return count


@kernel
def _collect(points, balls, near, line, tube, room):
    """Write the points in a tube around the line and its continuation; returns how many."""
    low, high = line.ends[0] - REACH, line.ends[1] + REACH
    count = 0
    for s in near:
        along, aside = axial(balls.centre, s, line.point, line.axis)
        radius = balls.radius[s]
        if aside > tube + radius or along < low - radius or along > high + radius:
            continue
        rows = balls.rows[balls.starts[s] : balls.starts[s + 1]]
        count += _within(points, rows, line, low, high, tube, room[count:])
    return count


@kernel
def _within(points, rows, line, low, high, tube, room):
    """Write the points in a tube around a part of the axis; returns how many.

    low, high: ends of the part, m. rows and room may start at the same place.
    """
    count = 0
    for i in rows:
        along, aside = axial(points, i, line.point, line.axis)
        if aside <= tube and low <= along <= high:
            room[count] = i
            count += 1
    return count


@kernel
def _find_ends(points, rows, inside, line):
    """Set the ends of the line: as far as the tube around it is free, from the middle on."""
    low = line.ends[0] - REACH
    bins = int(math.ceil((line.ends[1] + REACH - low) / BIN))
    within, around = np.zeros(bins), np.zeros(bins)
    for i in rows:
        along, aside = axial(points, i, line.point, line.axis)
        slot = min(bins - 1, int((along - low) / BIN))
        if aside <= inside:
            within[slot] += 1
        else:
            around[slot] += 1
    middle = min(bins - 1, int(-low / BIN))
    line.ends[1] = low + BIN * (_last_bin(within, around, middle - 1, 1) + 1)
    line.ends[0] = low + BIN * _last_bin(within, around, middle, -1)


@kernel
def _last_bin(within, around, start, step):
    """The last bin of a line in one direction, after `start`, before a hole or a crowd."""
    last, hole = start, 0
    slot = start + step
    while 0 <= slot < len(within) and hole <= MAX_HOLE:
        if within[slot] >= 1 and around[slot] <= MAX_AROUND * within[slot]:
            last, hole = slot, 0
        else:
            hole += 2 if around[slot] > max(1.0, MAX_AROUND * within[slot]) else 1
        slot += step
    return last


@kernel
def _recentre(line):
    """Apply the fit to the line: the point moves to its middle, and the axis turns."""
    point, axis, fit, ends = line
    u, v = across(axis)
    middle = 0.5 * (ends[0] + ends[1])
    point += fit[0] * u + fit[1] * v
    axis += fit[2] * u + fit[3] * v
    axis /= norm(axis)
    point += middle * axis
    ends -= middle
    fit[RADIUS] += fit[TAPER] * middle
    fit[:4] = 0.0


@kernel
def _orient(line):
    """Turn the line so that the largest component of its axis is positive."""
    if line.axis[np.argmax(np.abs(line.axis))] < 0.0:
        line.axis[:] = -line.axis
        line.fit[TAPER] = -line.fit[TAPER]
        line.ends[0], line.ends[1] = -line.ends[1], -line.ends[0]


@kernel
def _measure(points, rows, line, fits, which):
    """Fill in the fit of a line. Motions: along y and z, about y and z."""
    point, axis, fit, _ = line
    u, v = across(axis)
    fits.position[which] = point
    fits.axes[which, :, 0], fits.axes[which, :, 1], fits.axes[which, :, 2] = axis, u, v
    jacobian, local = np.empty(PARAMETERS), np.empty(3)
    total, mean, squared = 0.0, np.zeros(3), np.zeros(3)
    for i in rows:
        total += residual(points, i, point, u, v, axis, fit, jacobian) ** 2
    spread = math.sqrt(total / max(1, len(rows) - PARAMETERS))
    matrix, scores = np.zeros((PARAMETERS, PARAMETERS)), np.zeros((CHUNKS, PARAMETERS))
    matrix[RADIUS, RADIUS] = spread * spread / RADIUS_PRIOR**2
    matrix[TAPER, TAPER] = spread * spread / TAPER_PRIOR**2
    for k in range(len(rows)):
        error = residual(points, rows[k], point, u, v, axis, fit, jacobian)
        add_observation(jacobian, error, matrix, scores[k * CHUNKS // len(rows)])
        add_to_box(points, rows[k], fits, which, local)
        mean += local
        squared += local * local
    covariance = fit_covariance(matrix, scores, spread * spread)
    fits.count[which], fits.passes[which] = len(rows), count_passes(rows)
    fits.roughness[which] = spread
    variance = squared / len(rows) - (mean / len(rows)) ** 2
    fits.sigma[which] = np.sqrt(np.maximum(0.0, variance))
    # A slope of the axis along y is a turn about z; one along z is a turn about y, backwards.
    motion, sign = (1, 2, 5, 4), (1.0, 1.0, 1.0, -1.0)
    for m in range(4):
        for n in range(4):
            signed = sign[m] * sign[n] * covariance[m, n]
            fits.covariance[which, motion[m], motion[n]] = signed
