"""Products with chosen rows of a large matrix, of single precision or integers, that may lie on disk, never copied.

Each call runs in the caller's thread and keeps nothing, so that several threads may ask at once.
"""

import numpy as np
from numba import njit
from numpy import float32

from mixpinn.base.arrays import AnyArray, Float32Array, FloatArray, IntArray

_CHUNK = 2048
"""Columns that are summed up at a time: their sum stays in the nearest cache."""

# Inner loops run over slices from zero, which is what lets a compiler take several numbers at once.


@njit(fastmath=True, cache=True, nogil=True)
def combine_rows(matrix: AnyArray, rows: IntArray, factors: Float32Array, out: Float32Array) -> None:
    """out += Σ_k factors_k matrix[rows_k]."""
    for start in range(0, len(out), _CHUNK):
        stop = min(start + _CHUNK, len(out))
        part, whole = out[start:stop], len(rows) - len(rows) % 4
        # Four rows at a time: the sum is read and written once for four products.
        for k in range(0, whole, 4):
            a, b = matrix[rows[k], start:stop], matrix[rows[k + 1], start:stop]
            c, d = matrix[rows[k + 2], start:stop], matrix[rows[k + 3], start:stop]
            fa, fb, fc, fd = factors[k], factors[k + 1], factors[k + 2], factors[k + 3]
            for i in range(len(part)):
                part[i] += fa * a[i] + fb * b[i] + fc * c[i] + fd * d[i]
        for k in range(whole, len(rows)):
            a, fa = matrix[rows[k], start:stop], factors[k]
            for i in range(len(part)):
                part[i] += fa * a[i]


@njit(fastmath=True, cache=True, nogil=True)
def rows_times(matrix: AnyArray, rows: IntArray, vector: Float32Array, out: Float32Array) -> None:
    """out_k = matrix[rows_k] · vector."""
    whole = len(rows) - len(rows) % 4
    # Four rows at a time: the vector is read once for four products, and memory is asked for in four places at once.
    for k in range(0, whole, 4):
        a, b, c, d = matrix[rows[k]], matrix[rows[k + 1]], matrix[rows[k + 2]], matrix[rows[k + 3]]
        ta = tb = tc = td = float32(0.0)
        for i in range(len(vector)):
            ta += a[i] * vector[i]
            tb += b[i] * vector[i]
            tc += c[i] * vector[i]
            td += d[i] * vector[i]
        out[k], out[k + 1], out[k + 2], out[k + 3] = ta, tb, tc, td
    for k in range(whole, len(rows)):
        row, total = matrix[rows[k]], float32(0.0)
        for i in range(len(vector)):
            total += row[i] * vector[i]
        out[k] = total


@njit(cache=True, nogil=True)
def block_of(matrix: FloatArray, rows: IntArray) -> FloatArray:
    """The block of a square matrix that belongs to some of its rows and the columns of the same numbers, (l, l)."""
    block = np.empty((len(rows), len(rows)))
    for i in range(len(rows)):
        source, row = matrix[rows[i]], block[i]
        for j in range(len(rows)):
            row[j] = source[rows[j]]
    return block
