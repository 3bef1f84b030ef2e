"""Small systems of equations with symmetric positive definite matrices.

numba's own solvers need scipy, which the package does not.
"""

import math

from ellipseg_ros.core.jit import kernel


@kernel
def factorize(a, n):
    """Replace the lower triangle of a[:n, :n] by its Cholesky factor L, a = L L^T.

    Source: Golub & Van Loan, Matrix Computations, algorithm 4.2.1.
    """
    for j in range(n):
        for k in range(j):
            a[j, j] -= a[j, k] * a[j, k]
        a[j, j] = math.sqrt(a[j, j])
        for i in range(j + 1, n):
            for k in range(j):
                a[i, j] -= a[i, k] * a[j, k]
            a[i, j] /= a[j, j]


@kernel
def solve_lower(factor, n, b):
    """Replace b[:n] by L^-1 b; its square is then b^T a^-1 b."""
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
