"""First axis of a line: the best of lines through pairs of the points of a seed."""

import math

import numpy as np

from ellipseg_ros.core.jit import kernel
from ellipseg_ros.core.linalg.vectors import norm
from ellipseg_ros.landmarks.cylinder import axial

MIN_SEED_SIGMA = 0.25  # m: smallest standard deviation along a seed
TRIALS = 24  # pairs
TRIAL_DISTANCE = 0.25  # m: points nearer to a trial axis support it
FIRST_PAIR, SECOND_PAIR = 7919, 6101  # primes: different pairs in every trial


@kernel
def aim(points, rows, point, axis):
    """Turn a first axis to where most points lie; returns their RMS distance from it.

    The axes tried are lines through pairs of points, one from either end, so that other parts of
    the segment, a bough or leaves, have no influence. point, axis (3,): overwritten.
    """
    count = len(rows)
    along = np.empty(count)
    for k in range(count):
        along[k] = axial(points, rows[k], point, axis)[0]
    order = np.argsort(along, kind="mergesort")
    third = max(1, count // 3)
    best, through, direction = -1.0, point.copy(), axis.copy()
    a, b = point.copy(), axis.copy()
    for trial in range(TRIALS + 1):
        if trial > 0:
            i = rows[order[trial * FIRST_PAIR % third]]
            j = rows[order[count - 1 - trial * SECOND_PAIR % third]]
            a[:] = points[i]
            b[:] = points[j] - points[i]
            length = norm(b)
            if not length > MIN_SEED_SIGMA:
                continue
            b /= length
        score = 0.0
        for k in range(count):
            ratio = axial(points, rows[k], a, b)[1] / TRIAL_DISTANCE
            score += max(0.0, 1.0 - ratio * ratio)
        if score > best:
            best = score
            through[:], direction[:] = a, b
    total, support = 0.0, 0
    point[:] = 0.0
    for k in range(count):
        aside = axial(points, rows[k], through, direction)[1]
        if aside <= TRIAL_DISTANCE:
            support += 1
            total += aside * aside
            point += points[rows[k]]
    axis[:] = direction
    point /= max(1, support)
    return math.sqrt(total / max(1, support))
