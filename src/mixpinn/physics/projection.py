"""Directions of negative curvature of isotropic energies Ψ(I_C, J): what to add to make a cell's tangent SPD.

With signed singular values, F = U diag(σ) Vᵀ (U, V rotations), the tangent
a 1 + b F ⊗ F + c cof F ⊗ cof F + d ∂²J/∂F² has (Smith, de Goes & Kim 2018, section 4)

- three twists U (e_j e_kᵀ − e_k e_jᵀ) Vᵀ/√2 with eigenvalue a + d σ_i,
- three flips U (e_j e_kᵀ + e_k e_jᵀ) Vᵀ/√2 with eigenvalue a − d σ_i, (i, j, k) cyclic,
- three scalings U diag(v) Vᵀ, v the eigenvectors of the 3 × 3 matrix
  A_ij = a δ_ij + b σ_i σ_j + c g_i g_j + d σ_k (i ≠ j ≠ k ≠ i), g_i = σ_j σ_k.
"""

import math
from collections.abc import Callable
from typing import Any

import numba
import numpy as np

from mixpinn.base.arrays import BoolArray, FloatArray

_compiled: Callable[..., Any] = numba.njit(cache=True, nogil=True, fastmath={"contract"}, error_model="numpy")
_SWEEPS = 12
_HALF = math.sqrt(0.5)


@_compiled
def _diagonalise(matrix: FloatArray, vectors: FloatArray) -> None:
    """Cyclic Jacobi rotations: symmetric 3 × 3 `matrix` becomes diagonal, columns of `vectors` its eigenvectors."""
    for i in range(3):
        for j in range(3):
            vectors[i, j] = 1.0 if i == j else 0.0
    for _ in range(_SWEEPS):
        off = matrix[0, 1] * matrix[0, 1] + matrix[0, 2] * matrix[0, 2] + matrix[1, 2] * matrix[1, 2]
        scale = matrix[0, 0] * matrix[0, 0] + matrix[1, 1] * matrix[1, 1] + matrix[2, 2] * matrix[2, 2]
        if off <= 1e-24 * scale:
            return
        for p in range(2):
            for q in range(p + 1, 3):
                apq = matrix[p, q]
                if apq == 0.0:
                    continue
                theta = 0.5 * (matrix[q, q] - matrix[p, p]) / apq
                t = 1.0 / (abs(theta) + math.sqrt(theta * theta + 1.0))
                if theta < 0.0:
                    t = -t
                cosine = 1.0 / math.sqrt(t * t + 1.0)
                sine = t * cosine
                r = 3 - p - q
                arp, arq = matrix[r, p], matrix[r, q]
                matrix[p, p] -= t * apq
                matrix[q, q] += t * apq
                matrix[p, q] = matrix[q, p] = 0.0
                matrix[r, p] = matrix[p, r] = cosine * arp - sine * arq
                matrix[r, q] = matrix[q, r] = sine * arp + cosine * arq
                for i in range(3):
                    vip, viq = vectors[i, p], vectors[i, q]
                    vectors[i, p], vectors[i, q] = cosine * vip - sine * viq, sine * vip + cosine * viq


@_compiled
def _diagonalise_distinct(matrix: FloatArray, vectors: FloatArray) -> bool:
    """As `_diagonalise` but in closed form, eigenvalues descending, where all three are well apart; else False.

    With the mean q and p² = |A − q|²/6 the eigenvalues are q + 2 p cos(φ + 2πk/3), cos 3φ = det((A − q)/p)/2 (Smith
    1961); each eigenvector is orthogonal to two rows of A − λ.
    """
    q = (matrix[0, 0] + matrix[1, 1] + matrix[2, 2]) / 3.0
    a, b, c = matrix[0, 0] - q, matrix[1, 1] - q, matrix[2, 2] - q
    d, e, f = matrix[0, 1], matrix[0, 2], matrix[1, 2]
    p = math.sqrt((a * a + b * b + c * c + 2.0 * (d * d + e * e + f * f)) / 6.0)
    if p <= 1e-9 * q:
        return False
    a, b, c, d, e, f = a / p, b / p, c / p, d / p, e / p, f / p
    cosine = 0.5 * (a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e))
    if not abs(cosine) < 0.99:
        return False
    angle = math.acos(cosine) / 3.0
    first, last = 2.0 * math.cos(angle), 2.0 * math.cos(angle + 2.0 * math.pi / 3.0)
    for column, value in ((0, first), (2, last)):
        x0, x1, x2 = d * f - e * (b - value), e * d - (a - value) * f, (a - value) * (b - value) - d * d
        y0, y1, y2 = (b - value) * (c - value) - f * f, f * e - d * (c - value), d * f - (b - value) * e
        z0, z1, z2 = d * (c - value) - f * e, e * e - (a - value) * (c - value), (a - value) * f - d * e
        xx, yy, zz = x0 * x0 + x1 * x1 + x2 * x2, y0 * y0 + y1 * y1 + y2 * y2, z0 * z0 + z1 * z1 + z2 * z2
        if yy > xx:
            x0, x1, x2, xx = y0, y1, y2, yy
        if zz > xx:
            x0, x1, x2, xx = z0, z1, z2, zz
        scale = 1.0 / math.sqrt(xx)
        vectors[0, column], vectors[1, column], vectors[2, column] = scale * x0, scale * x1, scale * x2
    for i in range(3):  # the middle one: last × first, so that the columns are a rotation
        j, k = (i + 1) % 3, (i + 2) % 3
        vectors[i, 1] = vectors[j, 2] * vectors[k, 0] - vectors[k, 2] * vectors[j, 0]
    matrix[0, 0], matrix[1, 1], matrix[2, 2] = q + p * first, q - p * (first + last), q + p * last
    return True


@_compiled
def _right_vectors(f: FloatArray, squares: FloatArray, v: FloatArray) -> None:
    """FᵀF = V diag(σ²) Vᵀ: σ² descending on the diagonal of `squares`, `v` a rotation."""
    for i in range(3):
        for j in range(3):
            squares[i, j] = f[0, i] * f[0, j] + f[1, i] * f[1, j] + f[2, i] * f[2, j]
    if _diagonalise_distinct(squares, v):
        return
    _diagonalise(squares, v)
    for p, q in ((0, 1), (0, 2), (1, 2)):
        if squares[p, p] < squares[q, q]:
            squares[p, p], squares[q, q] = squares[q, q], squares[p, p]
            for i in range(3):
                v[i, p], v[i, q] = v[i, q], v[i, p]
    _cross_column(v)


@_compiled
def _left_vectors(f: FloatArray, v: FloatArray, u: FloatArray) -> None:
    """Columns u_i = F v_i/σ_i of a rotation, well defined for singular F too."""
    for i in range(3):
        u[i, 0] = f[i, 0] * v[0, 0] + f[i, 1] * v[1, 0] + f[i, 2] * v[2, 0]
        u[i, 1] = f[i, 0] * v[0, 1] + f[i, 1] * v[1, 1] + f[i, 2] * v[2, 1]
    largest = math.sqrt(u[0, 0] * u[0, 0] + u[1, 0] * u[1, 0] + u[2, 0] * u[2, 0])
    if largest == 0.0:
        u[:, :] = v
        return
    for i in range(3):
        u[i, 0] /= largest
    along = u[0, 0] * u[0, 1] + u[1, 0] * u[1, 1] + u[2, 0] * u[2, 1]
    for i in range(3):
        u[i, 1] -= along * u[i, 0]
    second = math.sqrt(u[0, 1] * u[0, 1] + u[1, 1] * u[1, 1] + u[2, 1] * u[2, 1])
    if second > 1e-12 * largest:
        for i in range(3):
            u[i, 1] /= second
    else:  # F of rank one: any direction across the first will do
        axis = 0
        for i in range(1, 3):
            if abs(u[i, 0]) < abs(u[axis, 0]):
                axis = i
        along = u[axis, 0]
        norm = math.sqrt(1.0 - along * along)
        for i in range(3):
            u[i, 1] = ((1.0 if i == axis else 0.0) - along * u[i, 0]) / norm
    _cross_column(u)


@_compiled
def _determinant(f: FloatArray) -> float:
    return (
        f[0, 0] * (f[1, 1] * f[2, 2] - f[1, 2] * f[2, 1]) - f[0, 1] * (f[1, 0] * f[2, 2] - f[1, 2] * f[2, 0])
        + f[0, 2] * (f[1, 0] * f[2, 1] - f[1, 1] * f[2, 0])
    )


@_compiled
def _cross_column(matrix: FloatArray) -> None:
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        matrix[i, 2] = matrix[j, 0] * matrix[k, 1] - matrix[k, 0] * matrix[j, 1]


@_compiled
def negative_modes(
    f: FloatArray, a: float, b: float, c: float, d: float, modes: FloatArray, shifts: FloatArray, work: FloatArray,
) -> int:
    """Eigenvectors Q of negative eigenvalue s of one cell's tangent into `modes` (9, 3, 3), −s into `shifts` (9,).

    The projected tangent is the tangent + Σ (−s) Q ⊗ Q.

    Args:
        f: deformation gradient, shape (3, 3).
        a, b, c, d: coefficients of the tangent [N/mm²], see above.
        modes, shifts: output.
        work: scratch, shape (6, 3, 3).

    Returns:
        How many there are.
    """
    u, v, small, rotation = work[1], work[2], work[3], work[4]
    _right_vectors(f, work[0], v)
    sigma, area = work[5, 0], work[5, 1]
    for i in range(3):
        sigma[i] = math.sqrt(max(work[0, i, i], 0.0))
    if _determinant(f) < 0.0:
        sigma[2] = -sigma[2]
    area[0], area[1], area[2] = sigma[1] * sigma[2], sigma[0] * sigma[2], sigma[0] * sigma[1]
    for i in range(3):
        for j in range(3):
            small[i, j] = b * sigma[i] * sigma[j] + c * area[i] * area[j]
            small[i, j] += a if i == j else d * sigma[3 - i - j]
    minor = small[0, 0] * small[1, 1] - small[0, 1] * small[0, 1]
    determinant = (
        small[2, 2] * minor - small[0, 0] * small[1, 2] * small[1, 2] - small[1, 1] * small[0, 2] * small[0, 2]
        + 2.0 * small[0, 1] * small[0, 2] * small[1, 2]
    )
    scaling_positive = small[0, 0] > 0.0 and minor > 0.0 and determinant > 0.0
    if scaling_positive and a >= abs(d) * sigma[0]:
        return 0
    _left_vectors(f, v, u)
    count = 0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        for sign in (1.0, -1.0):
            value = a + sign * d * sigma[i]
            if value < 0.0:
                for row in range(3):
                    for column in range(3):
                        modes[count, row, column] = _HALF * (
                            u[row, j] * v[column, k] - sign * u[row, k] * v[column, j]
                        )
                shifts[count] = -value
                count += 1
    if scaling_positive:
        return count
    _diagonalise(small, rotation)
    for mode in range(3):
        if small[mode, mode] < 0.0:
            for row in range(3):
                for column in range(3):
                    total = 0.0
                    for i in range(3):
                        total += rotation[i, mode] * u[row, i] * v[column, i]
                    modes[count, row, column] = total
            shifts[count] = -small[mode, mode]
            count += 1
    return count

def project_tangents(tangents: FloatArray) -> BoolArray:
    """Lift negative eigenvalues of symmetric 9 × 9 tangents (m, 9, 9) to zero, in place; returns which were changed."""
    values = np.linalg.eigvalsh(tangents)
    indefinite: BoolArray = values[:, 0] < 0.0
    if indefinite.any():
        values, vectors = np.linalg.eigh(tangents[indefinite])
        tangents[indefinite] = (vectors * np.maximum(values, 0.0)[:, None, :]) @ np.swapaxes(vectors, 1, 2)
    return indefinite
