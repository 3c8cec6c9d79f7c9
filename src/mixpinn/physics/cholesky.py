"""Small symmetric systems, compiled: no library's threads are woken.

A library divides a factorization of a hundred unknowns among threads that wait for each other without rest. Beside
another busy process that takes some hundred times as long as the work itself.
"""

import numba
import numpy as np

from mixpinn.physics.elimination import dot

# mypy cannot see through numba's decorators: the kernels are untyped, their callers are not.


@numba.njit(cache=True, nogil=True, fastmath={"contract"}, error_model="numpy")
def cholesky_in_place(matrix):  # type: ignore[no-untyped-def]
    """The lower triangle of a symmetric matrix (n, n) becomes L with L Lᵀ = matrix. False where it is not positive."""
    for i in range(len(matrix)):
        row = matrix[i]
        for j in range(i):
            row[j] = (row[j] - dot(row[:j], matrix[j, :j])) / matrix[j, j]
        rest = row[i] - dot(row[:i], row[:i])
        if not rest > 0.0:
            return False
        row[i] = np.sqrt(rest)
    return True


@numba.njit(cache=True, nogil=True, fastmath={"contract"}, error_model="numpy")
def cholesky_solve(lower, rhs):  # type: ignore[no-untyped-def]
    """The solution of L Lᵀ x = rhs replaces `rhs` (n,); what stands above the diagonal of `lower` does not count."""
    n = len(rhs)
    for i in range(n):
        rhs[i] = (rhs[i] - dot(lower[i, :i], rhs[:i])) / lower[i, i]
    for i in range(n - 1, -1, -1):
        rhs[i] /= lower[i, i]
        row, known = lower[i, :i], rhs[i]
        for j in range(i):
            rhs[j] -= known * row[j]
