"""Vectors of three components in kernels: arrays (3,) or tuples; results are tuples.

Sums run from x to z, so that every kernel rounds alike.
"""

import math

from ellipseg_ros.core.jit import inlined


@inlined
def row(array, i):
    """Row i of an array (n, 3); quicker than a view."""
    return array[i, 0], array[i, 1], array[i, 2]


@inlined
def column(matrix, k):
    """Column k of a matrix (3, 3)."""
    return matrix[0, k], matrix[1, k], matrix[2, k]


@inlined
def dot(a, b):
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def norm(a):
    """Length."""
    return math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


@inlined
def cross(a, b):
    """Vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def difference(a, b):
    """a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inlined
def combined(a, factor, b):
    """a + factor b."""
    return a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]


@inlined
def scaled(factor, a):
    """factor a."""
    return factor * a[0], factor * a[1], factor * a[2]
