"""Compiled element kernels of linear tetrahedra: energy, nodal forces and stiffness blocks, cell by cell.

Each kernel fills the entries ``start:stop`` of its output, releases the GIL and writes nothing else, so that ranges may
run in threads and the result does not depend on how many. Shapes, for m cells and n nodes: ``cells`` (m, 4) node ids,
``displacement`` (n, 3) [mm], ``gradients`` (m, 4, 3) rest gradients G_a of the shape functions [1/mm], ``volumes`` (m,)
[mm³], ``kinds`` (m,) one of the codes below, ``mu`` and ``lam`` (m,) [N/mm²].

Numba caches each file on its own: after a change of `mixpinn.physics.projection` this file's cache must be renewed too
(touch it, or delete ``__pycache__``).

The deformation gradient is kept as F = 1 + H with H = Σ_a u_a ⊗ G_a, so that small strains lose no digits.
"""

import math
from collections.abc import Callable
from typing import Any

import numba
import numpy as np

from mixpinn.base.arrays import AnyArray, FloatArray, IntArray
from mixpinn.physics.projection import negative_modes

STABLE, STABLE_LOG, LINEAR = 0, 1, 2
"""Codes of the built-in materials in ``kinds``."""

LOCAL_PAIRS = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])
"""The six pairs of a cell's nodes; blocks of a pair (a, a) follow from Σ_b K_ab = 0 (translations cost nothing)."""

compiled: Callable[..., Any] = numba.njit(cache=True, nogil=True, fastmath={"contract"}, error_model="numpy")


@compiled
def _displacement_gradient(cell: IntArray, displacement: FloatArray, gradient: FloatArray) -> Any:
    # Σ_a G_a = 0, so that only differences to node 0 enter.
    h00 = h01 = h02 = h10 = h11 = h12 = h20 = h21 = h22 = 0.0
    u0, u1, u2 = displacement[cell[0], 0], displacement[cell[0], 1], displacement[cell[0], 2]
    for a in range(1, 4):
        d0, d1, d2 = displacement[cell[a], 0] - u0, displacement[cell[a], 1] - u1, displacement[cell[a], 2] - u2
        g0, g1, g2 = gradient[a, 0], gradient[a, 1], gradient[a, 2]
        h00 += d0 * g0
        h01 += d0 * g1
        h02 += d0 * g2
        h10 += d1 * g0
        h11 += d1 * g1
        h12 += d1 * g2
        h20 += d2 * g0
        h21 += d2 * g1
        h22 += d2 * g2
    return h00, h01, h02, h10, h11, h12, h20, h21, h22


@compiled
def _invariants(h: Any) -> Any:
    """I_C − 3, J − 1 and (I_C − 3)/2 − (J − 1), the last without the tr H that the two have in common.

    I_C − 3 = 2 tr H + H : H and J − 1 = tr H + II(H) + det H.
    """
    h00, h01, h02, h10, h11, h12, h20, h21, h22 = h
    trace = h00 + h11 + h22
    square = h00 * h00 + h01 * h01 + h02 * h02 + h10 * h10 + h11 * h11 + h12 * h12 + h20 * h20 + h21 * h21 + h22 * h22
    second = h00 * h11 - h01 * h10 + h00 * h22 - h02 * h20 + h11 * h22 - h12 * h21
    third = h00 * (h11 * h22 - h12 * h21) - h01 * (h10 * h22 - h12 * h20) + h02 * (h10 * h21 - h11 * h20)
    return 2.0 * trace + square, trace + second + third, 0.5 * square - second - third


@compiled
def _log_excess(x: float) -> float:
    """x − log(1 + x), by its series where the difference would lose digits."""
    if abs(x) > 0.02:
        return x - math.log1p(x)
    return x * x * (1 / 2 - x * (1 / 3 - x * (1 / 4 - x * (1 / 5 - x * (1 / 6 - x * (1 / 7 - x / 8))))))


@compiled
def _coefficients(kind: int, mu: float, lam: float, shear: float, growth: float) -> Any:
    """(a, b, c, d) of P = a F + d cof F and ∂P/∂F = a 1 + b F ⊗ F + c cof F ⊗ cof F + d ∂²J/∂F²; see `material`."""
    if kind == STABLE:
        return mu, 0.0, lam + mu, (lam + mu) * growth - mu
    m, bulk, trace = 4.0 / 3.0 * mu, lam + 5.0 / 6.0 * mu, shear + 4.0
    return m * (1.0 - 1.0 / trace), 2.0 * m / (trace * trace), bulk, bulk * growth - 0.75 * m


@compiled
def _fill(h: Any, f: FloatArray, cofactor: FloatArray) -> None:
    f[0, 0], f[0, 1], f[0, 2] = 1.0 + h[0], h[1], h[2]
    f[1, 0], f[1, 1], f[1, 2] = h[3], 1.0 + h[4], h[5]
    f[2, 0], f[2, 1], f[2, 2] = h[6], h[7], 1.0 + h[8]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        cofactor[i, 0] = f[j, 1] * f[k, 2] - f[j, 2] * f[k, 1]
        cofactor[i, 1] = f[j, 2] * f[k, 0] - f[j, 0] * f[k, 2]
        cofactor[i, 2] = f[j, 0] * f[k, 1] - f[j, 1] * f[k, 0]


@compiled
def cell_jacobians(
    start: int, stop: int, cells: IntArray, displacement: FloatArray, gradients: FloatArray, out: FloatArray,
) -> None:
    """J = det F of each cell into `out` (m,)."""
    for e in range(start, stop):
        out[e] = 1.0 + _invariants(_displacement_gradient(cells[e], displacement, gradients[e]))[1]


@compiled
def cell_deformations(
    start: int, stop: int, cells: IntArray, displacement: FloatArray, gradients: FloatArray, out: FloatArray,
) -> None:
    """F of each cell into `out` (m, 3, 3)."""
    for e in range(start, stop):
        h = _displacement_gradient(cells[e], displacement, gradients[e])
        out[e, 0, 0], out[e, 0, 1], out[e, 0, 2] = 1.0 + h[0], h[1], h[2]
        out[e, 1, 0], out[e, 1, 1], out[e, 1, 2] = h[3], 1.0 + h[4], h[5]
        out[e, 2, 0], out[e, 2, 1], out[e, 2, 2] = h[6], h[7], 1.0 + h[8]


@compiled
def cell_energies(
    start: int, stop: int, cells: IntArray, displacement: FloatArray, gradients: FloatArray, volumes: FloatArray,
    kinds: AnyArray, mu: FloatArray, lam: FloatArray, out: FloatArray,
) -> None:
    """Energy of each cell [N mm] into `out` (m,), zero at rest."""
    for e in range(start, stop):
        h = _displacement_gradient(cells[e], displacement, gradients[e])
        h00, h01, h02, h10, h11, h12, h20, h21, h22 = h
        if kinds[e] == LINEAR:
            trace = h00 + h11 + h22
            strain = h00 * h00 + h11 * h11 + h22 * h22 + 0.5 * (
                (h01 + h10) * (h01 + h10) + (h02 + h20) * (h02 + h20) + (h12 + h21) * (h12 + h21)
            )
            density = mu[e] * strain + 0.5 * lam[e] * trace * trace
        else:
            shear, growth, excess = _invariants(h)
            if kinds[e] == STABLE:  # μ/2 (I_C − 3) − μ (J − 1) + (λ + μ)/2 (J − 1)²
                density = mu[e] * excess + 0.5 * (lam[e] + mu[e]) * growth * growth
            else:  # m/2 (I_C − 3) − 3m/4 (J − 1) − m/2 log(1 + (I_C − 3)/4) + l/2 (J − 1)², regrouped
                m, bulk = 4.0 / 3.0 * mu[e], lam[e] + 5.0 / 6.0 * mu[e]
                density = 0.5 * m * (1.5 * excess + _log_excess(0.25 * shear)) + 0.5 * bulk * growth * growth
        out[e] = volumes[e] * density


@compiled
def cell_forces(
    start: int, stop: int, cells: IntArray, displacement: FloatArray, gradients: FloatArray, volumes: FloatArray,
    kinds: AnyArray, mu: FloatArray, lam: FloatArray, out: FloatArray,
) -> None:
    """∂E/∂x_a = V P G_a of each cell [N] into `out` (m, 4, 3)."""
    f, p = np.empty((3, 3)), np.empty((3, 3))
    for e in range(start, stop):
        h = _displacement_gradient(cells[e], displacement, gradients[e])
        _fill(h, f, p)
        if kinds[e] == LINEAR:
            pressure = lam[e] * (h[0] + h[4] + h[8])
            for i in range(3):
                for j in range(3):
                    p[i, j] = mu[e] * (h[3 * i + j] + h[3 * j + i])
                p[i, i] += pressure
        else:
            shear, growth, _ = _invariants(h)
            a, _, _, d = _coefficients(kinds[e], mu[e], lam[e], shear, growth)
            for i in range(3):
                for j in range(3):
                    p[i, j] = a * f[i, j] + d * p[i, j]
        distribute(p, gradients[e], volumes[e], out[e])


@compiled
def distribute(stress: FloatArray, gradient: FloatArray, volume: float, out: FloatArray) -> None:
    """V P G_a of one cell into `out` (4, 3); node 0 takes what makes their sum zero."""
    for i in range(3):
        total = 0.0
        for a in range(1, 4):
            force = volume * (
                stress[i, 0] * gradient[a, 0] + stress[i, 1] * gradient[a, 1] + stress[i, 2] * gradient[a, 2]
            )
            out[a, i] = force
            total += force
        out[0, i] = -total


@compiled
def cell_blocks(
    start: int, stop: int, cells: IntArray, displacement: FloatArray, gradients: FloatArray, volumes: FloatArray,
    kinds: AnyArray, mu: FloatArray, lam: FloatArray, project: bool, out: FloatArray,
) -> None:
    """Stiffness ∂²E/∂x_a ∂x_b of the pairs `LOCAL_PAIRS` [N/mm] into `out` (m, 6, 3, 3).

    With a = G_a, b = G_b: V (a·b a_0 1 + b_0 (F a)(F b)ᵀ + c (cof F a)(cof F b)ᵀ + d [w]ᵀ), w = F (a × b), where
    a_0, b_0, c, d are the coefficients of ∂P/∂F; the last term is ∂²J contracted with G_a and G_b. `project` adds
    what lifts the negative eigenvalues of ∂P/∂F to zero.
    """
    f, cofactor = np.empty((3, 3)), np.empty((3, 3))
    fg, cg, qg = np.empty((4, 3)), np.empty((4, 3)), np.empty((4, 3))
    modes, shifts, work = np.empty((9, 3, 3)), np.empty(9), np.empty((6, 3, 3))
    for e in range(start, stop):
        gradient, volume, block = gradients[e], volumes[e], out[e]
        if kinds[e] == LINEAR:
            _linear_block(gradient, volume * mu[e], volume * lam[e], block)
            continue
        h = _displacement_gradient(cells[e], displacement, gradient)
        shear, growth, _ = _invariants(h)
        a0, b0, c, d = _coefficients(kinds[e], mu[e], lam[e], shear, growth)
        _fill(h, f, cofactor)
        _apply(f, gradient, fg)
        _apply(cofactor, gradient, cg)
        for pair in range(6):
            a, b = LOCAL_PAIRS[pair, 0], LOCAL_PAIRS[pair, 1]
            dot = gradient[a, 0] * gradient[b, 0] + gradient[a, 1] * gradient[b, 1] + gradient[a, 2] * gradient[b, 2]
            for i in range(3):
                for j in range(3):
                    block[pair, i, j] = volume * (c * cg[a, i] * cg[b, j] + b0 * fg[a, i] * fg[b, j])
                block[pair, i, i] += volume * a0 * dot
            n0 = gradient[a, 1] * gradient[b, 2] - gradient[a, 2] * gradient[b, 1]
            n1 = gradient[a, 2] * gradient[b, 0] - gradient[a, 0] * gradient[b, 2]
            n2 = gradient[a, 0] * gradient[b, 1] - gradient[a, 1] * gradient[b, 0]
            for i in range(3):
                w = volume * d * (f[i, 0] * n0 + f[i, 1] * n1 + f[i, 2] * n2)
                j, k = (i + 1) % 3, (i + 2) % 3
                block[pair, j, k] += w
                block[pair, k, j] -= w
        if project:
            for mode in range(negative_modes(f, a0, b0, c, d, modes, shifts, work)):
                _apply(modes[mode], gradient, qg)
                for pair in range(6):
                    a, b = LOCAL_PAIRS[pair, 0], LOCAL_PAIRS[pair, 1]
                    for i in range(3):
                        scaled = volume * shifts[mode] * qg[a, i]
                        for j in range(3):
                            block[pair, i, j] += scaled * qg[b, j]


@compiled
def _apply(matrix: FloatArray, gradient: FloatArray, out: FloatArray) -> None:
    for a in range(4):
        for i in range(3):
            out[a, i] = (
                matrix[i, 0] * gradient[a, 0] + matrix[i, 1] * gradient[a, 1] + matrix[i, 2] * gradient[a, 2]
            )


@compiled
def _linear_block(gradient: FloatArray, mu: float, lam: float, out: FloatArray) -> None:
    for pair in range(6):
        a, b = LOCAL_PAIRS[pair, 0], LOCAL_PAIRS[pair, 1]
        dot = gradient[a, 0] * gradient[b, 0] + gradient[a, 1] * gradient[b, 1] + gradient[a, 2] * gradient[b, 2]
        for i in range(3):
            for j in range(3):
                out[pair, i, j] = mu * gradient[b, i] * gradient[a, j] + lam * gradient[a, i] * gradient[b, j]
            out[pair, i, i] += mu * dot
