"""Nodal forces of the Stable Neo-Hookean material in single precision: the fast path of every prediction.

The same law as `STABLE` of `mixpinn.physics.linear_tetrahedron`, which solves use in double precision:
P = μ F + ((λ + μ)(J − 1) − μ) cof F, written in H = F − 1, so that small strains keep their digits. Cells are summed at
the nodes one after another, without threads and without work arrays: any number of callers may run it at once, and the
result is always the same.
"""

from typing import Any

import numpy as np
from numba import njit

from mixpinn.base.arrays import Float32Array, Int32Array
from mixpinn.physics.energies import LOCAL_PAIRS


@njit(fastmath=True, cache=True, nogil=True, error_model="numpy", inline="always")
def stable_stress(
    h00: Any, h01: Any, h02: Any, h10: Any, h11: Any, h12: Any, h20: Any, h21: Any, h22: Any, mu: Any, lam: Any,
) -> Any:
    """P of a displacement gradient H, nine numbers row by row, in the precision of its arguments."""
    # cof H, tr H, J − 1 = tr H + tr cof H + det H, and cof F = 1 + (tr H 1 − Hᵀ) + cof H
    k00, k01, k02 = h11 * h22 - h12 * h21, h12 * h20 - h10 * h22, h10 * h21 - h11 * h20
    k10, k11, k12 = h21 * h02 - h22 * h01, h22 * h00 - h20 * h02, h20 * h01 - h21 * h00
    k20, k21, k22 = h01 * h12 - h02 * h11, h02 * h10 - h00 * h12, h00 * h11 - h01 * h10
    trace = h00 + h11 + h22
    growth = trace + k00 + k11 + k22 + h00 * k00 + h01 * k01 + h02 * k02
    pressure = (lam + mu) * growth
    push = pressure - mu
    # P = μ (1 + H) + push (1 + C) with C = cof F − 1; the two unit matrices leave `pressure`.
    return (
        mu * h00 + push * (trace - h00 + k00) + pressure, mu * h01 + push * (k01 - h10), mu * h02 + push * (k02 - h20),
        mu * h10 + push * (k10 - h01), mu * h11 + push * (trace - h11 + k11) + pressure, mu * h12 + push * (k12 - h21),
        mu * h20 + push * (k20 - h02), mu * h21 + push * (k21 - h12), mu * h22 + push * (trace - h22 + k22) + pressure,
    )


@njit(fastmath=True, cache=True, nogil=True, error_model="numpy")
def add_stable_forces(
    cells: Int32Array, moved: Float32Array, gradients: Float32Array, volume: Float32Array, mu: Float32Array,
    lam: Float32Array, out: Float32Array,
) -> None:
    """Add V P G_a [N] of all four nodes of each cell to the nodal forces `out`.

    Args:
        cells: shape (m, 4).
        moved: displacement of the nodes [mm], shape (n, 3).
        gradients: G_1, G_2 and G_3 of each cell at rest [1/mm], shape (m, 9).
        volume: of each cell [mm³], shape (m,).
        mu, lam: Lamé constants of each cell [N/mm²], shape (m,).
        out: shape (n, 3).
    """
    for e in range(len(cells)):
        n0, n1, n2, n3 = cells[e, 0], cells[e, 1], cells[e, 2], cells[e, 3]
        u0, u1, u2 = moved[n0, 0], moved[n0, 1], moved[n0, 2]
        a0, a1, a2 = moved[n1, 0] - u0, moved[n1, 1] - u1, moved[n1, 2] - u2
        b0, b1, b2 = moved[n2, 0] - u0, moved[n2, 1] - u1, moved[n2, 2] - u2
        c0, c1, c2 = moved[n3, 0] - u0, moved[n3, 1] - u1, moved[n3, 2] - u2
        p0, p1, p2 = gradients[e, 0], gradients[e, 1], gradients[e, 2]
        q0, q1, q2 = gradients[e, 3], gradients[e, 4], gradients[e, 5]
        r0, r1, r2 = gradients[e, 6], gradients[e, 7], gradients[e, 8]
        h00, h01, h02 = a0 * p0 + b0 * q0 + c0 * r0, a0 * p1 + b0 * q1 + c0 * r1, a0 * p2 + b0 * q2 + c0 * r2
        h10, h11, h12 = a1 * p0 + b1 * q0 + c1 * r0, a1 * p1 + b1 * q1 + c1 * r1, a1 * p2 + b1 * q2 + c1 * r2
        h20, h21, h22 = a2 * p0 + b2 * q0 + c2 * r0, a2 * p1 + b2 * q1 + c2 * r1, a2 * p2 + b2 * q2 + c2 * r2
        s00, s01, s02, s10, s11, s12, s20, s21, s22 = stable_stress(
            h00, h01, h02, h10, h11, h12, h20, h21, h22, mu[e], lam[e],
        )
        v = volume[e]
        f3, f4, f5 = s00 * p0 + s01 * p1 + s02 * p2, s10 * p0 + s11 * p1 + s12 * p2, s20 * p0 + s21 * p1 + s22 * p2
        f6, f7, f8 = s00 * q0 + s01 * q1 + s02 * q2, s10 * q0 + s11 * q1 + s12 * q2, s20 * q0 + s21 * q1 + s22 * q2
        f9, g0, g1 = s00 * r0 + s01 * r1 + s02 * r2, s10 * r0 + s11 * r1 + s12 * r2, s20 * r0 + s21 * r1 + s22 * r2
        out[n0, 0] -= v * (f3 + f6 + f9)
        out[n0, 1] -= v * (f4 + f7 + g0)
        out[n0, 2] -= v * (f5 + f8 + g1)
        out[n1, 0] += v * f3
        out[n1, 1] += v * f4
        out[n1, 2] += v * f5
        out[n2, 0] += v * f6
        out[n2, 1] += v * f7
        out[n2, 2] += v * f8
        out[n3, 0] += v * f9
        out[n3, 1] += v * g0
        out[n3, 2] += v * g1


@njit(fastmath=True, cache=True, nogil=True, error_model="numpy")
def add_quadratic_stable_forces(
    cells: Int32Array, moved: Float32Array, gradients: Float32Array, volume: Float32Array, mu: Float32Array,
    lam: Float32Array, places: Float32Array, shares: Float32Array, out: Float32Array,
) -> None:
    """Add ∫ P ∂N_n/∂X [N] of all ten nodes of each cell to the nodal forces `out`.

    The displacement gradient is interpolated between those at the vertices, and the forces need the moments ∫ λ_b P
    alone; see `mixpinn.physics.quadratic_tetrahedron`.

    Args:
        cells: vertices and the midpoints of the pairs `LOCAL_PAIRS`, shape (m, 10).
        moved, volume, mu, lam, out: as in `add_stable_forces`.
        gradients: of the four barycentric coordinates at rest [1/mm], shape (m, 4, 3).
        places, shares: points and weights of a quadrature, shapes (p, 4) and (p,).
    """
    corner, moments, four = np.empty((4, 9), np.float32), np.empty((4, 9), np.float32), np.float32(4.0)
    for e in range(len(cells)):
        corner[:] = np.float32(0.0)
        moments[:] = np.float32(0.0)
        # d_b = 3 u_b and d_c = 4 u_bc − u_c at vertex b, both counted from u_b
        for pair in range(6):
            b, c, middle = LOCAL_PAIRS[pair, 0], LOCAL_PAIRS[pair, 1], cells[e, 4 + pair]
            for i in range(3):
                first, second, between = moved[cells[e, b], i], moved[cells[e, c], i], moved[middle, i]
                there, back = four * (between - first) - (second - first), four * (between - second) - (first - second)
                for j in range(3):
                    corner[b, 3 * i + j] += there * gradients[e, c, j]
                    corner[c, 3 * i + j] += back * gradients[e, b, j]
        stiff, bulk = mu[e], lam[e]
        for q in range(len(places)):
            a0, a1, a2, a3 = places[q, 0], places[q, 1], places[q, 2], places[q, 3]
            s00, s01, s02, s10, s11, s12, s20, s21, s22 = stable_stress(
                a0 * corner[0, 0] + a1 * corner[1, 0] + a2 * corner[2, 0] + a3 * corner[3, 0],
                a0 * corner[0, 1] + a1 * corner[1, 1] + a2 * corner[2, 1] + a3 * corner[3, 1],
                a0 * corner[0, 2] + a1 * corner[1, 2] + a2 * corner[2, 2] + a3 * corner[3, 2],
                a0 * corner[0, 3] + a1 * corner[1, 3] + a2 * corner[2, 3] + a3 * corner[3, 3],
                a0 * corner[0, 4] + a1 * corner[1, 4] + a2 * corner[2, 4] + a3 * corner[3, 4],
                a0 * corner[0, 5] + a1 * corner[1, 5] + a2 * corner[2, 5] + a3 * corner[3, 5],
                a0 * corner[0, 6] + a1 * corner[1, 6] + a2 * corner[2, 6] + a3 * corner[3, 6],
                a0 * corner[0, 7] + a1 * corner[1, 7] + a2 * corner[2, 7] + a3 * corner[3, 7],
                a0 * corner[0, 8] + a1 * corner[1, 8] + a2 * corner[2, 8] + a3 * corner[3, 8],
                stiff, bulk,
            )
            for b in range(4):
                factor = volume[e] * shares[q] * places[q, b]
                moments[b, 0] += factor * s00
                moments[b, 1] += factor * s01
                moments[b, 2] += factor * s02
                moments[b, 3] += factor * s10
                moments[b, 4] += factor * s11
                moments[b, 5] += factor * s12
                moments[b, 6] += factor * s20
                moments[b, 7] += factor * s21
                moments[b, 8] += factor * s22
        # ∫ P ∂N_a/∂X = (4 S_a − Σ_b S_b) G_a and ∫ P ∂N_ab/∂X = 4 (S_b G_a + S_a G_b)
        for i in range(3):
            t0 = moments[0, 3 * i] + moments[1, 3 * i] + moments[2, 3 * i] + moments[3, 3 * i]
            t1 = moments[0, 3 * i + 1] + moments[1, 3 * i + 1] + moments[2, 3 * i + 1] + moments[3, 3 * i + 1]
            t2 = moments[0, 3 * i + 2] + moments[1, 3 * i + 2] + moments[2, 3 * i + 2] + moments[3, 3 * i + 2]
            for a in range(4):
                out[cells[e, a], i] += (
                    (four * moments[a, 3 * i] - t0) * gradients[e, a, 0]
                    + (four * moments[a, 3 * i + 1] - t1) * gradients[e, a, 1]
                    + (four * moments[a, 3 * i + 2] - t2) * gradients[e, a, 2]
                )
            for pair in range(6):
                a, b = LOCAL_PAIRS[pair, 0], LOCAL_PAIRS[pair, 1]
                total = np.float32(0.0)
                for j in range(3):
                    total += moments[b, 3 * i + j] * gradients[e, a, j] + moments[a, 3 * i + j] * gradients[e, b, j]
                out[cells[e, 4 + pair], i] += four * total
