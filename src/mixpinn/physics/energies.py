"""The built-in energies at one point of a body, compiled: density, stress and the tangent between shape gradients.

A point is given by its displacement gradient H = ∂u/∂X, nine numbers row by row, and the constants of its material:
``kind``, one of the codes below, and μ and λ [N/mm²]. F = 1 + H is never formed where a difference is meant, so that
small strains lose no digits. The formulas and their sources are those of `mixpinn.fem.material`. `stable_stress` and
`nodal_force` work in the precision of their arguments: solves call them in double, predictions in single precision.

Numba caches each file on its own: after a change here the caches of the element kernels must be renewed too (touch
them, or delete ``__pycache__``).
"""

import math
from collections.abc import Callable
from typing import Any

import numba
import numpy as np

from mixpinn.base.arrays import AnyArray, FloatArray
from mixpinn.physics.projection import negative_modes

STABLE, STABLE_LOG, LINEAR = 0, 1, 2
"""Codes of the built-in materials."""

LOCAL_PAIRS = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])
"""The six pairs of a tetrahedron's vertices; blocks of a pair (a, a) follow from Σ_b K_ab = 0."""

compiled: Callable[..., Any] = numba.njit(cache=True, nogil=True, fastmath={"contract"}, error_model="numpy")
inlined: Callable[..., Any] = numba.njit(
    cache=True, nogil=True, fastmath={"contract"}, error_model="numpy", inline="always",
)
"""For what is called once a point: the call would cost as much as the work."""


@inlined
def invariants(h: Any) -> Any:
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


@inlined
def density(kind: int, mu: float, lam: float, h: Any) -> float:
    """Energy per rest volume [N/mm²], zero at rest."""
    if kind == LINEAR:
        h00, h01, h02, h10, h11, h12, h20, h21, h22 = h
        trace = h00 + h11 + h22
        strain = h00 * h00 + h11 * h11 + h22 * h22 + 0.5 * (
            (h01 + h10) * (h01 + h10) + (h02 + h20) * (h02 + h20) + (h12 + h21) * (h12 + h21)
        )
        return mu * strain + 0.5 * lam * trace * trace
    shear, growth, excess = invariants(h)
    if kind == STABLE:  # μ/2 (I_C − 3) − μ (J − 1) + (λ + μ)/2 (J − 1)²
        return mu * excess + 0.5 * (lam + mu) * growth * growth
    # m/2 (I_C − 3) − 3m/4 (J − 1) − m/2 log(1 + (I_C − 3)/4) + l/2 (J − 1)², regrouped
    m, bulk = 4.0 / 3.0 * mu, lam + 5.0 / 6.0 * mu
    return 0.5 * m * (1.5 * excess + _log_excess(0.25 * shear)) + 0.5 * bulk * growth * growth


@inlined
def _coefficients(kind: int, mu: float, lam: float, shear: float, growth: float) -> Any:
    """(a, b, c, d) of P = a F + d cof F and ∂P/∂F = a 1 + b F ⊗ F + c cof F ⊗ cof F + d ∂²J/∂F²."""
    if kind == STABLE:
        return mu, 0.0, lam + mu, (lam + mu) * growth - mu
    m, bulk, trace = 4.0 / 3.0 * mu, lam + 5.0 / 6.0 * mu, shear + 4.0
    return m * (1.0 - 1.0 / trace), 2.0 * m / (trace * trace), bulk, bulk * growth - 0.75 * m


@inlined
def _fill(h: Any, f: FloatArray, cofactor: FloatArray) -> None:
    f[0, 0], f[0, 1], f[0, 2] = 1.0 + h[0], h[1], h[2]
    f[1, 0], f[1, 1], f[1, 2] = h[3], 1.0 + h[4], h[5]
    f[2, 0], f[2, 1], f[2, 2] = h[6], h[7], 1.0 + h[8]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        cofactor[i, 0] = f[j, 1] * f[k, 2] - f[j, 2] * f[k, 1]
        cofactor[i, 1] = f[j, 2] * f[k, 0] - f[j, 0] * f[k, 2]
        cofactor[i, 2] = f[j, 0] * f[k, 1] - f[j, 1] * f[k, 0]


@inlined
def stable_stress(h: Any, mu: Any, lam: Any) -> Any:
    """First Piola-Kirchhoff stress [N/mm²] of the Stable Neo-Hookean, nine numbers row by row.

    P = μ F + ((λ + μ)(J − 1) − μ) cof F, written in H: with cof F = 1 + C, C = tr H 1 − Hᵀ + cof H, the two unit
    matrices of μ F and −μ cof F cancel.
    """
    h00, h01, h02, h10, h11, h12, h20, h21, h22 = h
    k00, k01, k02 = h11 * h22 - h12 * h21, h12 * h20 - h10 * h22, h10 * h21 - h11 * h20
    k10, k11, k12 = h21 * h02 - h22 * h01, h22 * h00 - h20 * h02, h20 * h01 - h21 * h00
    k20, k21, k22 = h01 * h12 - h02 * h11, h02 * h10 - h00 * h12, h00 * h11 - h01 * h10
    trace = h00 + h11 + h22
    # J − 1 = tr H + tr cof H + det H
    pressure = (lam + mu) * (trace + k00 + k11 + k22 + h00 * k00 + h01 * k01 + h02 * k02)
    push = pressure - mu
    return (
        mu * h00 + push * (trace - h00 + k00) + pressure, mu * h01 + push * (k01 - h10), mu * h02 + push * (k02 - h20),
        mu * h10 + push * (k10 - h01), mu * h11 + push * (trace - h11 + k11) + pressure, mu * h12 + push * (k12 - h21),
        mu * h20 + push * (k20 - h02), mu * h21 + push * (k21 - h12), mu * h22 + push * (trace - h22 + k22) + pressure,
    )


@inlined
def stable_stress_beyond_linear(h: Any, mu: Any, lam: Any) -> Any:
    """`stable_stress` less that of linear elasticity, μ (H + Hᵀ) + λ tr H 1; nothing cancels here.

    P less that is (λ + μ)((J − 1) cof F − tr H 1) − μ cof H, with C as above; J − 1 − tr H = tr cof H + det H.
    """
    h00, h01, h02, h10, h11, h12, h20, h21, h22 = h
    k00, k01, k02 = h11 * h22 - h12 * h21, h12 * h20 - h10 * h22, h10 * h21 - h11 * h20
    k10, k11, k12 = h21 * h02 - h22 * h01, h22 * h00 - h20 * h02, h20 * h01 - h21 * h00
    k20, k21, k22 = h01 * h12 - h02 * h11, h02 * h10 - h00 * h12, h00 * h11 - h01 * h10
    trace = h00 + h11 + h22
    further = k00 + k11 + k22 + h00 * k00 + h01 * k01 + h02 * k02
    growth, base = (lam + mu) * (trace + further), (lam + mu) * further
    return (
        base + growth * (trace - h00 + k00) - mu * k00, growth * (k01 - h10) - mu * k01,
        growth * (k02 - h20) - mu * k02, growth * (k10 - h01) - mu * k10,
        base + growth * (trace - h11 + k11) - mu * k11, growth * (k12 - h21) - mu * k12,
        growth * (k20 - h02) - mu * k20, growth * (k21 - h12) - mu * k21,
        base + growth * (trace - h22 + k22) - mu * k22,
    )


@inlined
def stress(kind: int, mu: float, lam: float, h: Any, f: FloatArray, cofactor: FloatArray) -> Any:
    """First Piola-Kirchhoff stress [N/mm²], nine numbers row by row; `f` and `cofactor` (3, 3) are scratch."""
    if kind == STABLE:
        return stable_stress(h, mu, lam)
    if kind == LINEAR:
        h00, h01, h02, h10, h11, h12, h20, h21, h22 = h
        pressure, xy, xz, yz = lam * (h00 + h11 + h22), mu * (h01 + h10), mu * (h02 + h20), mu * (h12 + h21)
        return (
            2.0 * mu * h00 + pressure, xy, xz, xy, 2.0 * mu * h11 + pressure, yz, xz, yz, 2.0 * mu * h22 + pressure,
        )
    _fill(h, f, cofactor)
    shear, growth, _ = invariants(h)
    a, _, _, d = _coefficients(kind, mu, lam, shear, growth)
    for i in range(3):
        for j in range(3):
            f[i, j] = a * f[i, j] + d * cofactor[i, j]
    return entries(f)


@inlined
def entries(matrix: FloatArray) -> Any:
    """Nine numbers of a matrix (3, 3), row by row."""
    return (
        matrix[0, 0], matrix[0, 1], matrix[0, 2], matrix[1, 0], matrix[1, 1], matrix[1, 2], matrix[2, 0], matrix[2, 1],
        matrix[2, 2],
    )


@inlined
def nodal_force(stress: Any, gradient: AnyArray, a: int) -> Any:
    """P G_a, three numbers, of a stress and the vertices' gradients (4, 3)."""
    s00, s01, s02, s10, s11, s12, s20, s21, s22 = stress
    g0, g1, g2 = gradient[a, 0], gradient[a, 1], gradient[a, 2]
    return s00 * g0 + s01 * g1 + s02 * g2, s10 * g0 + s11 * g1 + s12 * g2, s20 * g0 + s21 * g1 + s22 * g2


@inlined
def distribute(stress: Any, gradient: FloatArray, volume: float, out: FloatArray) -> None:
    """V P G_a into `out` (4, 3) for the vertices' gradients G_a (4, 3); vertex 0 takes what makes their sum zero."""
    for a in range(1, 4):
        out[a, 0], out[a, 1], out[a, 2] = nodal_force(stress, gradient, a)
    for i in range(3):
        for a in range(1, 4):
            out[a, i] *= volume
        out[0, i] = -(out[1, i] + out[2, i] + out[3, i])


@inlined
def _apply(matrix: FloatArray, gradient: FloatArray, out: FloatArray) -> None:
    for a in range(4):
        for i in range(3):
            out[a, i] = (
                matrix[i, 0] * gradient[a, 0] + matrix[i, 1] * gradient[a, 1] + matrix[i, 2] * gradient[a, 2]
            )


@inlined
def _linear_blocks(gradient: FloatArray, mu: float, lam: float, out: FloatArray) -> None:
    for pair in range(6):
        a, b = LOCAL_PAIRS[pair, 0], LOCAL_PAIRS[pair, 1]
        dot = gradient[a, 0] * gradient[b, 0] + gradient[a, 1] * gradient[b, 1] + gradient[a, 2] * gradient[b, 2]
        for i in range(3):
            for j in range(3):
                out[pair, i, j] = mu * gradient[b, i] * gradient[a, j] + lam * gradient[a, i] * gradient[b, j]
            out[pair, i, i] += mu * dot


@inlined
def tangent_blocks(
    kind: int, mu: float, lam: float, h: Any, gradient: FloatArray, volume: float, project: bool, f: FloatArray,
    cofactor: FloatArray, fg: FloatArray, cg: FloatArray, modes: FloatArray, shifts: FloatArray, work: FloatArray,
    out: FloatArray,
) -> None:
    """V G_a · ∂P/∂F · G_b of the pairs `LOCAL_PAIRS` of four gradients [N/mm] into `out` (6, 3, 3).

    With a = G_a, b = G_b: V (a·b a_0 1 + b_0 (F a)(F b)ᵀ + c (cof F a)(cof F b)ᵀ + d [w]ᵀ), w = F (a × b), where
    a_0, b_0, c, d are the coefficients of ∂P/∂F; the last term is ∂²J contracted with G_a and G_b.

    Args:
        kind, mu, lam: the material.
        h: displacement gradient.
        gradient: G_a [1/mm], shape (4, 3).
        volume: V [mm³].
        project: add what lifts the negative eigenvalues of ∂P/∂F to zero.
        f, cofactor, fg, cg, modes, shifts, work: scratch of shapes (3, 3), (3, 3), (4, 3), (4, 3), (9, 3, 3), (9,),
            (6, 3, 3).
        out: output.
    """
    if kind == LINEAR:
        _linear_blocks(gradient, volume * mu, volume * lam, out)
        return
    shear, growth, _ = invariants(h)
    a0, b0, c, d = _coefficients(kind, mu, lam, shear, growth)
    _fill(h, f, cofactor)
    _apply(f, gradient, fg)
    _apply(cofactor, gradient, cg)
    for pair in range(6):
        a, b = LOCAL_PAIRS[pair, 0], LOCAL_PAIRS[pair, 1]
        dot = gradient[a, 0] * gradient[b, 0] + gradient[a, 1] * gradient[b, 1] + gradient[a, 2] * gradient[b, 2]
        for i in range(3):
            for j in range(3):
                out[pair, i, j] = volume * (c * cg[a, i] * cg[b, j] + b0 * fg[a, i] * fg[b, j])
            out[pair, i, i] += volume * a0 * dot
        n0 = gradient[a, 1] * gradient[b, 2] - gradient[a, 2] * gradient[b, 1]
        n1 = gradient[a, 2] * gradient[b, 0] - gradient[a, 0] * gradient[b, 2]
        n2 = gradient[a, 0] * gradient[b, 1] - gradient[a, 1] * gradient[b, 0]
        for i in range(3):
            w = volume * d * (f[i, 0] * n0 + f[i, 1] * n1 + f[i, 2] * n2)
            j, k = (i + 1) % 3, (i + 2) % 3
            out[pair, j, k] += w
            out[pair, k, j] -= w
    if project:
        for mode in range(negative_modes(f, a0, b0, c, d, modes, shifts, work)):
            _apply(modes[mode], gradient, fg)
            for pair in range(6):
                a, b = LOCAL_PAIRS[pair, 0], LOCAL_PAIRS[pair, 1]
                for i in range(3):
                    scaled = volume * shifts[mode] * fg[a, i]
                    for j in range(3):
                        out[pair, i, j] += scaled * fg[b, j]
