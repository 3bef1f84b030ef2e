"""Lines that can be found again: trunks, poles, pipes, as round things that stand out."""

import math
from typing import NamedTuple

import numpy as np

from ellipseg_ros.config import LandmarksConfig
from ellipseg_ros.core.flat_moments import COUNT, EIGENVALUES, MEAN, V1
from ellipseg_ros.core.jit import kernel
from ellipseg_ros.core.members import Boxes, Members
from ellipseg_ros.landmarks.cylinder import PARAMETERS, across, fit_cylinder, place, residual
from ellipseg_ros.landmarks.fits import CHUNKS, Fits, chosen, no_fits, passages, uncertainty
from ellipseg_ros.records import Array

LONG = 0.25  # m: least standard deviation along a segment that a line is looked for at,
LONGEST = 1000.0  # m: and at most, for a stray point far away stretches a segment without end,
WIDE = 0.35  # m: and the largest across,
THIN = 0.5  # and as a share of that along
SHEET = 0.08  # m: thickness of a piece of ground or wall, if it is as wide as LONG
FEW = 12  # points that such a segment has at least
STRIP = 0.03  # m: a segment no thicker may be a strip of something round and wider
WIDEST = 0.45  # m: largest radius, points that stick out included
SHORTEST = 1.0  # m: least length of a line
TAPERING = 0.1  # largest change of the radius along it
NEAR = (2.0, 15.0)  # m across and along: segments this near to a first axis are looked at
BIN = 0.2  # m along the axis
AROUND = 0.25  # m: a tube around the line that is to be free
REACH = 1.0  # m beyond its ends where its continuation is looked for, at a time
HOLE = 4  # bins without a point that do not end a line
ROUNDS = 6
TRIALS = 24
CLOSE = 0.25  # m: from an axis that is tried


class Lines(NamedTuple):
    """Lines and what they are made of."""

    fits: Fits
    points: Members  # of each
    taken: Array  # (n,) bool: points of lines, landmarks or not


class Pieces(NamedTuple):
    """The segments, and where they are."""

    starts: Array  # (s + 1,) int64: rows of their points
    rows: Array
    centre: Array  # (s, 3) m: of a ball around it
    reach: Array  # (s,) m: its radius


class Line(NamedTuple):
    """A line while it grows."""

    point: Array  # (3,) m, on the axis
    axis: Array  # (3,)
    fit: Array  # (PARAMETERS,), see cylinder.py
    reach: Array  # (2,) m: ends, along the axis from the point


def find_lines(
    points: Array, inside: Members, own: Array, around: Boxes, flat: Array, config: LandmarksConfig
) -> Lines:
    """The lines of a window.

    points (n, 3) m, local origin; inside: those of every segment; own (s, 24): their moments;
    around: their boxes; flat (s,) bool: segments that are no part of lines.
    Segments that are long and thin propose lines, the longest and largest first; all points near
    the axis decide where it lies and how far it goes: as long as the tube around it is free.
    """
    sigma = np.sqrt(own[:, EIGENVALUES : EIGENVALUES + 3])
    seeds = (
        ~flat
        & ~((sigma[:, 1] > LONG) & (sigma[:, 0] < SHEET))
        & (own[:, COUNT] >= FEW)
        & (sigma[:, 2] >= LONG)
        & (sigma[:, 2] <= LONGEST)
    )
    seeds &= (sigma[:, 1] <= WIDE) & (sigma[:, 1] < THIN * sigma[:, 2])
    order = np.flatnonzero(seeds)
    order = order[np.argsort(-own[order, COUNT] * sigma[order, 2], kind="stable")]
    centre, reach = 0.5 * (around.low + around.high), 0.5 * (around.high - around.low)
    pieces = Pieces(*inside, centre, np.linalg.norm(reach, axis=1))
    fits, shapes = no_fits(len(order)), np.zeros((len(order), 2))
    line_of_point = np.full(len(points), -1, np.int32)
    _find_all(points, pieces, own, order, fits, shapes, line_of_point)
    good = (fits.count >= config.min_points) & (2 * fits.passages >= config.min_points)
    good &= (fits.high[:, 0] - fits.low[:, 0] >= SHORTEST) & (np.abs(shapes[:, 1]) <= TAPERING)
    good &= fits.roughness <= config.roughness
    rows = np.flatnonzero(line_of_point >= 0)
    rows = rows[np.argsort(line_of_point[rows], kind="stable")]
    kept = rows[good[line_of_point[rows]]]
    counts = np.bincount(line_of_point[kept], minlength=len(good))[good]
    return Lines(
        chosen(fits, good), Members(np.append(0, np.cumsum(counts)), kept), line_of_point >= 0
    )


@kernel
def _find_all(points, pieces, own, order, fits, shapes, line_of_point):
    room = np.empty(len(points), np.int64)
    near = np.empty(len(pieces.reach), np.int64)
    for which in range(len(order)):
        seed = order[which]
        if _taken(pieces.rows[pieces.starts[seed] : pieces.starts[seed + 1]], line_of_point):
            continue
        line = Line(np.empty(3), np.empty(3), np.zeros(PARAMETERS), np.zeros(2))
        count = _grow(points, pieces, own, seed, 0.0, near, room, line)
        strip = own[seed, EIGENVALUES] < STRIP * STRIP
        if strip and (count < FEW or line.reach[1] - line.reach[0] < SHORTEST):
            count = _grow(points, pieces, own, seed, WIDEST, near, room, line)
        rows = room[:count]
        if count < FEW or _taken(rows, line_of_point):
            continue
        _orient(line)
        _measure(points, rows, line, fits, which)
        shapes[which, 0], shapes[which, 1] = line.fit[4], line.fit[5]
        for i in rows:
            line_of_point[i] = which


@kernel
def _taken(rows, line_of_point):
    """Whether most of the points are in a line already."""
    taken = 0
    for i in rows:
        taken += line_of_point[i] >= 0
    return taken > 0.3 * len(rows)


@kernel
def _grow(points, pieces, own, seed, least, near, room, line):
    """Let a line grow from a segment; returns how many points, ascending, `room` holds of it.

    least: radius of the first tube, m, if that of the segment is less.
    """
    point, axis, fit, reach = line
    point[:] = own[seed, MEAN : MEAN + 3]
    axis[:] = own[seed, V1 : V1 + 3]
    across_it = _aim(points, pieces.rows[pieces.starts[seed] : pieces.starts[seed + 1]], line)
    inside = min(max(2.5 * across_it, 0.1, least), WIDEST)
    along_it = math.sqrt(own[seed, EIGENVALUES + 2])
    reach[0], reach[1] = -1.8 * along_it, 1.8 * along_it
    fit[4] = min(1.4 * across_it, 0.3)
    close = _near(pieces, line, near)
    count, length = 0, -1.0
    for _round in range(ROUNDS):
        got = _collect(points, pieces, near[:close], line, inside + AROUND, room)
        _stretch(points, room[:got], inside, line)
        count = 0
        for k in range(got):
            along, aside = place(points, room[k], point, axis)
            if reach[0] <= along <= reach[1] and aside <= inside:
                room[count] = room[k]
                count += 1
        if count < FEW:
            return 0
        room[:count] = np.sort(room[:count])
        spread = fit_cylinder(points, room[:count], point, axis, fit)
        if not spread < 0.2:
            return 0
        fit[4] = min(max(fit[4], 0.01), WIDEST)
        inside = min(fit[4] + max(2.5 * spread, 0.03) + 0.02, WIDEST + 0.1)
        _recentre(line)
        if abs(reach[1] - reach[0] - length) < 0.5 * BIN:
            break
        length = reach[1] - reach[0]
    return count


@kernel
def _aim(points, rows, line):
    """Turn a first axis to where most points lie; returns how far they are from it, rms.

    Tried are lines through pairs of points, one from either end: what else is in the segment, a
    bough or leaves, then does not count.
    """
    point, axis = line.point, line.axis
    count = len(rows)
    along = np.empty(count)
    for k in range(count):
        along[k] = place(points, rows[k], point, axis)[0]
    order = np.argsort(along, kind="mergesort")
    third = max(1, count // 3)
    best, through, direction = -1.0, point.copy(), axis.copy()
    a, b = point.copy(), axis.copy()
    for trial in range(TRIALS + 1):
        if trial > 0:  # primes: another pair each time
            i = rows[order[trial * 7919 % third]]
            j = rows[order[count - 1 - trial * 6101 % third]]
            a[:] = points[i]
            b[:] = points[j] - points[i]
            length = math.sqrt(b[0] * b[0] + b[1] * b[1] + b[2] * b[2])
            if not length > LONG:
                continue
            b /= length
        score = 0.0
        for k in range(count):
            ratio = place(points, rows[k], a, b)[1] / CLOSE
            score += max(0.0, 1.0 - ratio * ratio)
        if score > best:
            best = score
            through[:], direction[:] = a, b
    total, members = 0.0, 0
    point[:] = 0.0
    for k in range(count):
        aside = place(points, rows[k], through, direction)[1]
        if aside <= CLOSE:
            members += 1
            total += aside * aside
            point += points[rows[k]]
    axis[:] = direction
    point /= max(1, members)
    return math.sqrt(total / max(1, members))


@kernel
def _near(pieces, line, near):
    """Write the segments that may come near the line; returns how many."""
    count = 0
    centre = pieces.centre
    px, py, pz = line.point[0], line.point[1], line.point[2]
    for s in range(len(pieces.reach)):
        x, y, z = centre[s, 0] - px, centre[s, 1] - py, centre[s, 2] - pz
        farthest = NEAR[0] + NEAR[1] + pieces.reach[s]
        if x * x + y * y + z * z > farthest * farthest:
            continue  # most of them
        along, aside = place(centre, s, line.point, line.axis)
        if aside <= NEAR[0] + pieces.reach[s] and abs(along) <= NEAR[1] + pieces.reach[s]:
            near[count] = s
            count += 1
    return count


@kernel
def _collect(points, pieces, near, line, radius, room):
    """Write the points in a tube around the line and its continuation; returns how many."""
    low, high = line.reach[0] - REACH, line.reach[1] + REACH
    count = 0
    for s in near:
        along, aside = place(pieces.centre, s, line.point, line.axis)
        reach = pieces.reach[s]
        if aside > radius + reach or along < low - reach or along > high + reach:
            continue
        for k in range(pieces.starts[s], pieces.starts[s + 1]):
            along, aside = place(points, pieces.rows[k], line.point, line.axis)
            if aside <= radius and low <= along <= high:
                room[count] = pieces.rows[k]
                count += 1
    return count


@kernel
def _stretch(points, rows, inside, line):
    """Set the ends of the line: as far as it stands out, from the middle on."""
    low = line.reach[0] - REACH
    bins = int(math.ceil((line.reach[1] + REACH - low) / BIN))
    within, around = np.zeros(bins), np.zeros(bins)
    for i in rows:
        along, aside = place(points, i, line.point, line.axis)
        slot = min(bins - 1, int((along - low) / BIN))
        if aside <= inside:
            within[slot] += 1
        else:
            around[slot] += 1
    middle = min(bins - 1, int(-low / BIN))
    line.reach[1] = low + BIN * (_end(within, around, middle - 1, 1) + 1)
    line.reach[0] = low + BIN * _end(within, around, middle, -1)


@kernel
def _end(within, around, start, step):
    """The last bin, from the one behind `start` on, before the line ends or is grown over."""
    last, hole = start, 0
    slot = start + step
    while 0 <= slot < len(within) and hole <= HOLE:
        if within[slot] >= 1 and around[slot] <= 0.5 * within[slot]:
            last, hole = slot, 0
        else:
            hole += 2 if around[slot] > max(1.0, 0.5 * within[slot]) else 1
        slot += step
    return last


@kernel
def _recentre(line):
    """Take over what was fitted: the point moves to the middle, and the axis turns."""
    point, axis, fit, reach = line
    u, v = across(axis)
    middle = 0.5 * (reach[0] + reach[1])
    point += fit[0] * u + fit[1] * v
    axis += fit[2] * u + fit[3] * v
    axis /= math.sqrt(axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2])
    point += middle * axis
    reach -= middle
    fit[4] += fit[5] * middle
    fit[:4] = 0.0


@kernel
def _orient(line):
    """Let the largest component of the axis be positive."""
    largest = line.axis[0]
    for k in range(1, 3):
        if abs(line.axis[k]) > abs(largest):
            largest = line.axis[k]
    if largest < 0.0:
        line.axis[:] = -line.axis
        line.fit[5] = -line.fit[5]
        line.reach[0], line.reach[1] = -line.reach[1], -line.reach[0]


@kernel
def _measure(points, rows, line, fits, which):
    """Fill in what is told of a line. Motions: along y and z, about y and z."""
    point, axis = line.point, line.axis
    u, v = across(axis)
    total, squared, count = 0.0, np.zeros(3), 0
    mean, low, high = np.zeros(3), np.full(3, np.inf), np.full(3, -np.inf)
    spot, jacobian = np.empty(3), np.empty(PARAMETERS)
    for i in rows:
        total += residual(points, i, point, u, v, axis, line.fit, jacobian) ** 2
    spread = math.sqrt(total / max(1, len(rows) - PARAMETERS))
    matrix, scores = np.zeros((PARAMETERS, PARAMETERS)), np.zeros((CHUNKS, PARAMETERS))
    matrix[4, 4], matrix[5, 5] = spread * spread / 0.1**2, spread * spread / 0.03**2
    for k in range(len(rows)):
        error = residual(points, rows[k], point, u, v, axis, line.fit, jacobian)
        for m in range(PARAMETERS):
            scores[k * CHUNKS // len(rows), m] += jacobian[m] * error
            for n in range(m + 1):
                matrix[m, n] += jacobian[m] * jacobian[n]
        spot[:] = 0.0
        for c in range(3):
            offset = points[rows[k], c] - point[c]
            spot[0] += offset * axis[c]
            spot[1] += offset * u[c]
            spot[2] += offset * v[c]
        count += 1
        for m in range(3):
            mean[m] += spot[m]
            squared[m] += spot[m] * spot[m]
            low[m], high[m] = min(low[m], spot[m]), max(high[m], spot[m])
    found = uncertainty(matrix, scores, spread * spread)
    fits.count[which], fits.passages[which] = count, passages(rows)
    fits.roughness[which] = spread
    fits.position[which] = point
    fits.axes[which, :, 0], fits.axes[which, :, 1], fits.axes[which, :, 2] = axis, u, v
    fits.low[which], fits.high[which] = low, high
    fits.sigma[which] = np.sqrt(np.maximum(0.0, squared / count - (mean / count) ** 2))
    # A slope of the axis along y is a turn about z; one along z is a turn about y, backwards.
    motion, sign = (1, 2, 5, 4), (1.0, 1.0, 1.0, -1.0)
    for m in range(4):
        for n in range(4):
            fits.covariance[which, motion[m], motion[n]] = sign[m] * sign[n] * found[m, n]
