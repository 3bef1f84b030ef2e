"""Cholesky factorisation and solution of small symmetric positive definite systems, in kernels.

numba's own solvers would need scipy's BLAS; these work on views of preallocated arrays.
Source: Golub & Van Loan, Matrix Computations, algorithm 4.2.1.
"""

import math

from ellipseg_ros.core.jit import kernel


@kernel
def factorize(a, n):
    """Replace the lower triangle of a[:n, :n] by its Cholesky factor L, where a = L L^T.

    Returns whether the matrix is positive definite; if not, a[:n, :n] becomes NaN.
    """
    for j in range(n):
        for k in range(j):
            a[j, j] -= a[j, k] * a[j, k]
        if not a[j, j] > 0.0:
            a[:n, :n] = math.nan
            return False
        a[j, j] = math.sqrt(a[j, j])
        for i in range(j + 1, n):
            for k in range(j):
                a[i, j] -= a[i, k] * a[j, k]
            a[i, j] /= a[j, j]
    return True


@kernel
def solve(factor, n, b):
    """Replace b[:n] by the solution x of L L^T x = b."""
    solve_lower(factor, n, b)
    solve_upper(factor, n, b)


@kernel
def solve_lower(factor, n, b):
    """Replace b[:n] by L^-1 b; the squared norm of that is b^T a^-1 b."""
    for i in range(n):
        for k in range(i):
            b[i] -= factor[i, k] * b[k]
        b[i] /= factor[i, i]


@kernel
def solve_upper(factor, n, b):
    """Replace b[:n] by L^-T b."""
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            b[i] -= factor[k, i] * b[k]
        b[i] /= factor[i, i]


@kernel
def log_determinant(factor, n):
    """Natural logarithm of the determinant of a = L L^T."""
    total = 0.0
    for i in range(n):
        total += math.log(factor[i, i])
    return 2.0 * total
