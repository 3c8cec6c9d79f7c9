"""Small dense linear algebra, compiled: no library's threads are woken, and results do not depend on their number."""

import numba

# mypy cannot see through numba's decorators: the kernels are untyped, their callers are not. Sums keep the order in
# which they are written (no ``fastmath=True``): else results would depend on what is compiled together with what.


@numba.njit(cache=True, nogil=True, fastmath={"contract"})
def solve_in_place(matrix, rhs):  # type: ignore[no-untyped-def]
    """Gaussian elimination with row pivoting; the solution replaces `rhs`. False where the matrix is singular.

    Four columns at a time, so that what lies right of them is read and written once for four pivots.
    """
    n = len(rhs)
    for first in range(0, n, 4):
        last = min(first + 4, n)
        for k in range(first, last):
            for i in range(k, n):  # what the pivots of these four columns before this one do to it
                row = matrix[i]
                for c in range(first, k):
                    row[k] -= row[c] * matrix[c, k]
            best, size = k, abs(matrix[k, k])
            for i in range(k + 1, n):
                if abs(matrix[i, k]) > size:
                    best, size = i, abs(matrix[i, k])
            if not size > 1e-300:
                return False
            if best != k:
                for j in range(n):
                    held = matrix[k, j]
                    matrix[k, j] = matrix[best, j]
                    matrix[best, j] = held
                held = rhs[k]
                rhs[k] = rhs[best]
                rhs[best] = held
            inverse = 1.0 / matrix[k, k]
            for i in range(k + 1, n):
                matrix[i, k] *= inverse
            pivot = matrix[k]
            for c in range(first, k):
                factor, upper = pivot[c], matrix[c]
                for j in range(k + 1, last):
                    pivot[j] -= factor * upper[j]
                for j in range(last, n):
                    pivot[j] -= factor * upper[j]
                rhs[k] -= factor * rhs[c]
        if last - first == 4:
            u0, u1, u2, u3 = matrix[first], matrix[first + 1], matrix[first + 2], matrix[first + 3]
            for i in range(last, n):
                row = matrix[i]
                l0, l1, l2, l3 = row[first], row[first + 1], row[first + 2], row[first + 3]
                for j in range(last, n):
                    row[j] -= l0 * u0[j] + l1 * u1[j] + l2 * u2[j] + l3 * u3[j]
                rhs[i] -= l0 * rhs[first] + l1 * rhs[first + 1] + l2 * rhs[first + 2] + l3 * rhs[first + 3]
    for k in range(n - 1, -1, -1):
        row = matrix[k]
        total = rhs[k]
        for j in range(k + 1, n):
            total -= row[j] * rhs[j]
        rhs[k] = total / row[k]
    return True


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
def times(matrix, vector, out):  # type: ignore[no-untyped-def]
    """out = matrix vector."""
    for i in range(len(out)):
        out[i] = dot(matrix[i], vector)
