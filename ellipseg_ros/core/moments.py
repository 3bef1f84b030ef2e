"""Moments of point sets, and the shape of the ellipsoids that they describe."""

import numpy as np

from ellipseg_ros.core.jit import inlined, kernel
from ellipseg_ros.core.linalg.eigen import eigen
from ellipseg_ros.records import Array

# 24 float64, three cache lines; what an edge weight and the first term of the shape distance read
# stands first. count: points; mean: m, local origin; v1, v2, v3: axes, by descending eigenvalue;
# e1 >= e2 >= e3: eigenvalues, clipped at 0, m^2; xx to zz: covariance, divided by the count, m^2.
_COMPONENTS = (
    "count mean_x mean_y mean_z v3_x v3_y v3_z e3 e2 e1 planarity cylindricality "
    "v2_x v2_y v2_z v1_x v1_y v1_z xx xy xz yy yz zz"
).split()
# The same bytes as vectors; eigenvalues ascend. In kernels m["mean"], as m.mean is a method of
# numpy where the JIT is off.
_VECTORS = {
    "mean": ("mean_x", 3),
    "v1": ("v1_x", 3),
    "v2": ("v2_x", 3),
    "v3": ("v3_x", 3),
    "eigenvalues": ("e3", 3),
    "covariance": ("xx", 6),
}


def _moments_dtype() -> "np.dtype[np.record]":
    offsets = {name: 8 * place for place, name in enumerate(_COMPONENTS)}
    vectors = {name: offsets[first] for name, (first, _) in _VECTORS.items()}
    fields = {
        "names": [*offsets, *vectors],
        "formats": ["f8"] * len(offsets) + [f"({size},)f8" for _, size in _VECTORS.values()],
        "offsets": [*offsets.values(), *vectors.values()],
        "itemsize": 8 * len(offsets),
    }
    return np.dtype((np.record, fields))


MOMENTS = _moments_dtype()
IDENTITY = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


def no_moments(size: int = 0) -> Array:
    """Array (size,) of MOMENTS, all zero."""
    return np.zeros(size, MOMENTS)


def united(moments: Array, group: Array, count: int) -> Array:
    """Moments (count,) of groups of disjoint point sets, united in the order of rows.

    moments (s,); group (s,) int32: the group of each row.
    """
    unions = no_moments(count)
    _unite_groups(moments, group, unions)
    return unions


@kernel
def shape(moments, row):
    """Set eigenvalues, axes, planarity and cylindricality by the covariance (paper, eqs. 3-5)."""
    m = moments[row]
    m.e1, m.e2, m.e3, axes = eigen(m.xx, m.xy, m.xz, m.yy, m.yz, m.zz)
    m.v1_x, m.v1_y, m.v1_z, m.v2_x, m.v2_y, m.v2_z, m.v3_x, m.v3_y, m.v3_z = axes
    total = m.e1 + m.e2 + m.e3
    if total > 0.0:
        m.planarity = 2.0 * (m.e2 - m.e3) / total
        m.cylindricality = (m.e1 - m.e2) / total
    else:
        m.planarity = m.cylindricality = 0.0
        m.v1_x, m.v1_y, m.v1_z, m.v2_x, m.v2_y, m.v2_z, m.v3_x, m.v3_y, m.v3_z = IDENTITY


@inlined
def add_products(m, offset):
    """Add the products of an offset (x, y, z) to the covariance of a record, m^2."""
    x, y, z = offset
    m.xx += x * x
    m.xy += x * y
    m.xz += x * z
    m.yy += y * y
    m.yz += y * z
    m.zz += z * z


@kernel
def unite(moments, row_a, row_b, row_union):
    """Set row `row_union` to the moments of two disjoint point sets taken together.

    Source: Chan, Golub & LeVeque (1979), pairwise update, for covariances instead of sums.
    """
    a, b, union = moments[row_a], moments[row_b], moments[row_union]
    _unite(a, b, union)
    shape(moments, row_union)


@kernel
def _unite(a, b, union):
    count = a.count + b.count
    fa, fb = a.count / count, b.count / count
    dx, dy, dz = b.mean_x - a.mean_x, b.mean_y - a.mean_y, b.mean_z - a.mean_z
    between = fa * fb
    union.count = count
    union.mean_x = a.mean_x + fb * dx
    union.mean_y = a.mean_y + fb * dy
    union.mean_z = a.mean_z + fb * dz
    union.xx = fa * a.xx + fb * b.xx + between * dx * dx
    union.xy = fa * a.xy + fb * b.xy + between * dx * dy
    union.xz = fa * a.xz + fb * b.xz + between * dx * dz
    union.yy = fa * a.yy + fb * b.yy + between * dy * dy
    union.yz = fa * a.yz + fb * b.yz + between * dy * dz
    union.zz = fa * a.zz + fb * b.zz + between * dz * dz


@kernel
def _unite_groups(moments, group, unions):
    for row in range(len(moments)):
        into = group[row]
        if unions[into].count == 0.0:
            unions[into] = moments[row]
        else:
            _unite(unions[into], moments[row], unions[into])
            shape(unions, into)
