"""Analytic eigenvectors of negative curvature of isotropic energies Ψ(I_C, J): what to add to make a cell's tangent SPD.

With the signed singular values F = U diag(σ) Vᵀ (U, V rotations), the tangent a 1 + b F ⊗ F + c cof F ⊗ cof F + d ∂²J/∂F²
has (Smith, de Goes & Kim 2018, section 4; Kim & Eberle 2022, chapter 7)

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

from mixpinn.base.arrays import FloatArray

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
        if off <= 1e-28 * scale:
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
def _signed_singular_values(f: FloatArray, u: FloatArray, v: FloatArray, work: FloatArray) -> Any:
    """F = U diag(σ) Vᵀ with rotations U, V (columns) and σ_0 ≥ σ_1 ≥ |σ_2|, the last one negative where det F is."""
    for i in range(3):
        for j in range(3):
            work[i, j] = f[0, i] * f[0, j] + f[1, i] * f[1, j] + f[2, i] * f[2, j]
    _diagonalise(work, v)
    # Selection of the two largest; the third column follows from the cross product, which makes V a rotation.
    first, last = 0, 0
    for i in range(1, 3):
        if work[i, i] > work[first, first]:
            first = i
    last = (first + 1) % 3 if work[(first + 1) % 3, (first + 1) % 3] < work[(first + 2) % 3, (first + 2) % 3] else (
        first + 2) % 3
    middle = 3 - first - last
    for i in range(3):
        work[0, i], work[1, i] = v[i, first], v[i, middle]
    for i in range(3):
        v[i, 0], v[i, 1] = work[0, i], work[1, i]
    _cross_column(v)
    for i in range(3):
        u[i, 0] = f[i, 0] * v[0, 0] + f[i, 1] * v[1, 0] + f[i, 2] * v[2, 0]
        u[i, 1] = f[i, 0] * v[0, 1] + f[i, 1] * v[1, 1] + f[i, 2] * v[2, 1]
    s0 = math.sqrt(u[0, 0] * u[0, 0] + u[1, 0] * u[1, 0] + u[2, 0] * u[2, 0])
    if s0 == 0.0:
        u[:, :] = v
        return 0.0, 0.0, 0.0
    for i in range(3):
        u[i, 0] /= s0
    along = u[0, 0] * u[0, 1] + u[1, 0] * u[1, 1] + u[2, 0] * u[2, 1]
    for i in range(3):
        u[i, 1] -= along * u[i, 0]
    s1 = math.sqrt(u[0, 1] * u[0, 1] + u[1, 1] * u[1, 1] + u[2, 1] * u[2, 1])
    if s1 > 1e-12 * s0:
        for i in range(3):
            u[i, 1] /= s1
    else:  # F of rank one: any direction across the first will do
        s1 = 0.0
        axis = 0
        for i in range(1, 3):
            if abs(u[i, 0]) < abs(u[axis, 0]):
                axis = i
        along = u[axis, 0]
        norm = math.sqrt(1.0 - along * along)
        for i in range(3):
            u[i, 1] = ((1.0 if i == axis else 0.0) - along * u[i, 0]) / norm
    _cross_column(u)
    s2 = 0.0
    for i in range(3):
        s2 += u[i, 2] * (f[i, 0] * v[0, 2] + f[i, 1] * v[1, 2] + f[i, 2] * v[2, 2])
    return s0, s1, s2


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
    s0, s1, s2 = _signed_singular_values(f, u, v, work[0])
    sigma, area = work[5, 0], work[5, 1]
    sigma[0], sigma[1], sigma[2] = s0, s1, s2
    area[0], area[1], area[2] = s1 * s2, s0 * s2, s0 * s1
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
    for i in range(3):
        for j in range(3):
            small[i, j] = b * sigma[i] * sigma[j] + c * area[i] * area[j]
            small[i, j] += a if i == j else d * sigma[3 - i - j]
    minor = small[0, 0] * small[1, 1] - small[0, 1] * small[0, 1]
    determinant = (
        small[2, 2] * minor - small[0, 0] * small[1, 2] * small[1, 2] - small[1, 1] * small[0, 2] * small[0, 2]
        + 2.0 * small[0, 1] * small[0, 2] * small[1, 2]
    )
    if small[0, 0] > 0.0 and minor > 0.0 and determinant > 0.0:
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


def eigenvalues_of_tangent(f: FloatArray, a: float, b: float, c: float, d: float) -> FloatArray:
    """The nine eigenvalues of one cell's tangent by the formulas above, ascending, shape (9,) [N/mm²]."""
    u, _, vt = np.linalg.svd(f)
    sigma = np.linalg.svd(f, compute_uv=False)
    sigma[2] *= np.sign(np.linalg.det(u @ vt))
    area = np.prod(sigma) / sigma
    coupling = np.array([[0.0, sigma[2], sigma[1]], [sigma[2], 0.0, sigma[0]], [sigma[1], sigma[0], 0.0]])
    scaling = a * np.eye(3) + b * np.outer(sigma, sigma) + c * np.outer(area, area) + d * coupling
    return np.sort(np.concatenate([a + d * sigma, a - d * sigma, np.linalg.eigvalsh(scaling)]))
