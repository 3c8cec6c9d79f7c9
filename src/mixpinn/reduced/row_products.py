"""Products with chosen rows of a large single-precision matrix that may lie on disk: the rows are never copied.

Each call runs in the caller's thread and keeps nothing, so that several threads may ask at once.
"""

import numpy as np
from numba import njit
from numpy import float32

from mixpinn.base.arrays import Float32Array, FloatArray, IntArray

_CHUNKS = 64


@njit(fastmath=True, cache=True, nogil=True)
def combine_rows(matrix: Float32Array, rows: IntArray, factors: Float32Array, out: Float32Array) -> None:
    """out += Σ_k factors_k matrix[rows_k]."""
    size = len(out)
    for chunk in range(_CHUNKS):
        start, stop = chunk * size // _CHUNKS, (chunk + 1) * size // _CHUNKS
        whole = len(rows) - len(rows) % 4
        # Four rows at a time: the sum is read and written once for four products.
        for k in range(0, whole, 4):
            a, b, c, d = matrix[rows[k]], matrix[rows[k + 1]], matrix[rows[k + 2]], matrix[rows[k + 3]]
            fa, fb, fc, fd = factors[k], factors[k + 1], factors[k + 2], factors[k + 3]
            for i in range(start, stop):
                out[i] += fa * a[i] + fb * b[i] + fc * c[i] + fd * d[i]
        for k in range(whole, len(rows)):
            a, fa = matrix[rows[k]], factors[k]
            for i in range(start, stop):
                out[i] += fa * a[i]


@njit(fastmath=True, cache=True, nogil=True)
def rows_times(matrix: Float32Array, rows: IntArray, vector: Float32Array, out: Float32Array) -> None:
    """out_k = matrix[rows_k] · vector."""
    for k in range(len(rows)):
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
