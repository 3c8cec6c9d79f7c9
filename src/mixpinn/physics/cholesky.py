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
    """The lower triangle of a symmetric matrix (n, n) becomes L with L Lᵀ = matrix. False where it is not positive.

    Four columns at a time: they are factorized side by side in a buffer, and what lies right of them is read and
    written once for four pivots, two rows together. What stands above the diagonal afterwards means nothing.
    """
    n = len(matrix)
    panel = np.empty((4, n))
    for first in range(0, n, 4):
        width = min(4, n - first)
        for i in range(first, n):
            row = matrix[i]
            for c in range(width):
                panel[c, i] = row[first + c]
        for c in range(width):
            k = first + c
            column = panel[c]
            if not column[k] > 0.0:
                return False
            root = np.sqrt(column[k])
            inverse = 1.0 / root
            column[k] = root
            below = panel[c, k + 1 :]
            for i in range(len(below)):
                below[i] *= inverse
            for d in range(c + 1, width):
                other, factor, under = panel[d, first + d :], panel[c, first + d], panel[c, first + d :]
                for i in range(len(other)):
                    other[i] -= factor * under[i]
        for i in range(first, n):
            row = matrix[i]
            for c in range(min(width, i - first + 1)):
                row[first + c] = panel[c, i]
        last = first + width
        if width < 4:
            continue
        p0, p1, p2, p3 = panel[0, last:], panel[1, last:], panel[2, last:], panel[3, last:]
        whole = last + (n - last) // 2 * 2
        for i in range(last, whole, 2):
            length = i - last + 2
            row, under = matrix[i, last : last + length], matrix[i + 1, last : last + length]
            a0, a1, a2, a3 = p0[length - 2], p1[length - 2], p2[length - 2], p3[length - 2]
            b0, b1, b2, b3 = p0[length - 1], p1[length - 1], p2[length - 1], p3[length - 1]
            for j in range(len(row)):
                row[j] -= a0 * p0[j] + a1 * p1[j] + a2 * p2[j] + a3 * p3[j]
                under[j] -= b0 * p0[j] + b1 * p1[j] + b2 * p2[j] + b3 * p3[j]
        for i in range(whole, n):
            row = matrix[i, last : i + 1]
            a0, a1, a2, a3 = p0[i - last], p1[i - last], p2[i - last], p3[i - last]
            for j in range(len(row)):
                row[j] -= a0 * p0[j] + a1 * p1[j] + a2 * p2[j] + a3 * p3[j]
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
