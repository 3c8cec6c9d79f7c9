"""Small dense linear algebra, compiled: no library's threads are woken, and results do not depend on their number."""

import numba
import numpy as np

# mypy cannot see through numba's decorators: the kernels are untyped, their callers are not. Sums keep the order in
# which they are written (no ``fastmath=True``): else results would depend on what is compiled together with what.


@numba.njit(cache=True, nogil=True, fastmath={"contract"}, error_model="numpy")
def solve_in_place(matrix, rhs):  # type: ignore[no-untyped-def]
    """Gaussian elimination with row pivoting; the solution replaces `rhs`. False where the matrix is singular.

    Four columns at a time: they are eliminated side by side in a buffer, and what lies right of them is read and
    written once for four pivots. Inner loops run over slices from zero, which is what lets a compiler take several
    numbers at once.
    """
    n = len(rhs)
    panel = np.empty((4, n))
    for first in range(0, n, 4):
        width = min(4, n - first)
        last = first + width
        for i in range(first, n):
            for c in range(width):
                panel[c, i] = matrix[i, first + c]
        for c in range(width):
            k = first + c
            column = panel[c]
            best, size = k, abs(column[k])
            for i in range(k + 1, n):
                if abs(column[i]) > size:
                    best, size = i, abs(column[i])
            if not size > 1e-300:
                return False
            if best != k:
                _swap(panel[:width], matrix[:, last:], rhs, k, best)
            inverse = 1.0 / column[k]
            below = panel[c, k + 1 :]
            for i in range(len(below)):
                below[i] *= inverse
            for d in range(c + 1, width):
                other, upper = panel[d, k + 1 :], panel[d, k]
                for i in range(len(other)):
                    other[i] -= below[i] * upper
            for d in range(c, width):
                matrix[k, first + d] = panel[d, k]
            pivot = matrix[k, last:]
            for b in range(c):
                factor, above = panel[b, k], matrix[first + b, last:]
                for j in range(len(pivot)):
                    pivot[j] -= factor * above[j]
                rhs[k] -= factor * rhs[first + b]
        if width == 4:
            u0, u1 = matrix[first, last:], matrix[first + 1, last:]
            u2, u3 = matrix[first + 2, last:], matrix[first + 3, last:]
            r0, r1, r2, r3 = rhs[first], rhs[first + 1], rhs[first + 2], rhs[first + 3]
            whole = n - (n - last) % 2
            for i in range(last, whole, 2):  # two rows at a time: those of the pivots are read once for both
                row, next_row = matrix[i, last:], matrix[i + 1, last:]
                l0, l1, l2, l3 = panel[0, i], panel[1, i], panel[2, i], panel[3, i]
                m0, m1, m2, m3 = panel[0, i + 1], panel[1, i + 1], panel[2, i + 1], panel[3, i + 1]
                for j in range(len(row)):
                    row[j] -= l0 * u0[j] + l1 * u1[j] + l2 * u2[j] + l3 * u3[j]
                    next_row[j] -= m0 * u0[j] + m1 * u1[j] + m2 * u2[j] + m3 * u3[j]
                rhs[i] -= l0 * r0 + l1 * r1 + l2 * r2 + l3 * r3
                rhs[i + 1] -= m0 * r0 + m1 * r1 + m2 * r2 + m3 * r3
            for i in range(whole, n):
                row = matrix[i, last:]
                l0, l1, l2, l3 = panel[0, i], panel[1, i], panel[2, i], panel[3, i]
                for j in range(len(row)):
                    row[j] -= l0 * u0[j] + l1 * u1[j] + l2 * u2[j] + l3 * u3[j]
                rhs[i] -= l0 * r0 + l1 * r1 + l2 * r2 + l3 * r3
    for k in range(n - 1, -1, -1):
        row, known = matrix[k, k + 1 :], rhs[k + 1 :]
        rhs[k] = (rhs[k] - dot(row, known)) / matrix[k, k]
    return True


@numba.njit(cache=True, nogil=True)
def _swap(panel, right, rhs, k, best):  # type: ignore[no-untyped-def]
    """Exchange two rows of a panel (columns first), of what lies right of it, and of the right-hand side."""
    for d in range(len(panel)):
        held = panel[d, k]
        panel[d, k] = panel[d, best]
        panel[d, best] = held
    for j in range(right.shape[1]):
        held = right[k, j]
        right[k, j] = right[best, j]
        right[best, j] = held
    held = rhs[k]
    rhs[k] = rhs[best]
    rhs[best] = held


@numba.njit(cache=True, nogil=True, fastmath={"contract"})
def dot(left, right):  # type: ignore[no-untyped-def]
    """Σ left right, in eight sums side by side, which a processor adds at once."""
    n = len(right)
    s0 = s1 = s2 = s3 = s4 = s5 = s6 = s7 = 0.0
    whole = n - n % 8
    for j in range(0, whole, 8):
        s0 += left[j] * right[j]
        s1 += left[j + 1] * right[j + 1]
        s2 += left[j + 2] * right[j + 2]
        s3 += left[j + 3] * right[j + 3]
        s4 += left[j + 4] * right[j + 4]
        s5 += left[j + 5] * right[j + 5]
        s6 += left[j + 6] * right[j + 6]
        s7 += left[j + 7] * right[j + 7]
    total = ((s0 + s1) + (s2 + s3)) + ((s4 + s5) + (s6 + s7))
    for j in range(whole, n):
        total += left[j] * right[j]
    return total


@numba.njit(cache=True, nogil=True, fastmath={"contract"})
def symmetric_times(matrix, vector, out):  # type: ignore[no-untyped-def]
    """out = matrix vector for a symmetric matrix: the sum of its rows, of which those by a zero cost nothing."""
    n = len(vector)
    out[:] = 0.0
    j = 0
    while j < n:
        v0 = vector[j]
        if v0 == 0.0:
            j += 1
            continue
        if j + 2 < n:
            v1, v2, row0, row1, row2 = vector[j + 1], vector[j + 2], matrix[j], matrix[j + 1], matrix[j + 2]
            for i in range(n):
                out[i] += v0 * row0[i] + v1 * row1[i] + v2 * row2[i]
            j += 3
        else:
            row0 = matrix[j]
            for i in range(n):
                out[i] += v0 * row0[i]
            j += 1
