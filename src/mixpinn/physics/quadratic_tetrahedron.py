"""Compiled element kernels of straight-sided ten-node tetrahedra: energy, nodal forces and stiffness, cell by cell.

The nodes of a cell are its four vertices and the midpoints of the edges `LOCAL_PAIRS`, in this order. With the
barycentric coordinates λ_a and their constant gradients G_a, the shape functions are N_a = λ_a (2 λ_a − 1) at vertices
and N_ab = 4 λ_a λ_b at midpoints, so that at a point

    ∂N_a/∂X = (4 λ_a − 1) G_a,    ∂N_ab/∂X = 4 λ_b G_a + 4 λ_a G_b.

Every gradient is a combination Σ_c B_nc G_c of the same four. At a quadrature point the cell is therefore a linear
tetrahedron whose vertices move by d_c = Σ_n B_nc u_n: the displacement gradient is Σ_c d_c ⊗ G_c, and the blocks of
that tetrahedron go to the nodes by B and Bᵀ. Since B is linear in λ, the displacement gradient is interpolated between
those at the vertices, and the forces need the four moments ∫ λ_b P alone.

Each kernel fills the entries ``start:stop`` of its output and writes nothing else. Shapes as in
`mixpinn.physics.linear_tetrahedron`, but ``cells`` (m, 10); ``places`` (p, 4) and ``shares`` (p,) are the points and
weights of a `Quadrature`.

Numba caches each file on its own: after a change of `mixpinn.physics.energies` or `projection` this file's cache must
be renewed too (touch it, or delete ``__pycache__``).
"""

from typing import Any

import numpy as np

from mixpinn.base.arrays import AnyArray, FloatArray, IntArray
from mixpinn.physics.energies import LOCAL_PAIRS, compiled, density, inlined, invariants, stress, tangent_blocks

NODE_PAIRS = np.array([(a, b) for a in range(10) for b in range(a + 1, 10)])
"""The 45 pairs of a cell's nodes, in the order of its stiffness blocks."""

EDGE_OF = np.array([[-1, 0, 1, 2], [0, -1, 3, 4], [1, 3, -1, 5], [2, 4, 5, -1]])
"""Row of `LOCAL_PAIRS` for two vertices of a cell."""


@inlined
def vertex_gradients(cell: AnyArray, displacement: AnyArray, gradient: AnyArray, out: AnyArray) -> None:
    """Displacement gradients at the vertices into `out` (4, 9); elsewhere they are Σ_b λ_b H_b.

    At vertex b, d_b = 3 u_b and d_c = 4 u_bc − u_c for the other vertices, all counted from u_b. Works in the precision
    of its arguments, as do `gradient_at`, `add_moments` and `distribute_moments`.
    """
    for b in range(4):
        for k in range(9):
            out[b, k] = 0
    for pair in range(6):
        b, c, middle = LOCAL_PAIRS[pair, 0], LOCAL_PAIRS[pair, 1], cell[4 + pair]
        for i in range(3):
            first, second, between = displacement[cell[b], i], displacement[cell[c], i], displacement[middle, i]
            ahead, behind = between - first, between - second
            ahead += ahead  # twice, and again: a factor 4 would be one in double precision
            behind += behind
            ahead += ahead - (second - first)
            behind += behind - (first - second)
            for j in range(3):
                out[b, 3 * i + j] += ahead * gradient[c, j]
                out[c, 3 * i + j] += behind * gradient[b, j]


@inlined
def gradient_at(corner: AnyArray, place: AnyArray) -> Any:
    """Displacement gradient at a place, from those at the vertices (4, 9)."""
    a, b, c, d = place[0], place[1], place[2], place[3]
    return (
        a * corner[0, 0] + b * corner[1, 0] + c * corner[2, 0] + d * corner[3, 0],
        a * corner[0, 1] + b * corner[1, 1] + c * corner[2, 1] + d * corner[3, 1],
        a * corner[0, 2] + b * corner[1, 2] + c * corner[2, 2] + d * corner[3, 2],
        a * corner[0, 3] + b * corner[1, 3] + c * corner[2, 3] + d * corner[3, 3],
        a * corner[0, 4] + b * corner[1, 4] + c * corner[2, 4] + d * corner[3, 4],
        a * corner[0, 5] + b * corner[1, 5] + c * corner[2, 5] + d * corner[3, 5],
        a * corner[0, 6] + b * corner[1, 6] + c * corner[2, 6] + d * corner[3, 6],
        a * corner[0, 7] + b * corner[1, 7] + c * corner[2, 7] + d * corner[3, 7],
        a * corner[0, 8] + b * corner[1, 8] + c * corner[2, 8] + d * corner[3, 8],
    )


@compiled
def cell_jacobians(
    start: int, stop: int, cells: IntArray, displacement: FloatArray, gradients: FloatArray, places: FloatArray,
    out: FloatArray,
) -> None:
    """J = det F of each cell at each of `places` into `out` (m, p)."""
    corner = np.empty((4, 9))
    for e in range(start, stop):
        vertex_gradients(cells[e], displacement, gradients[e], corner)
        for q in range(len(places)):
            out[e, q] = 1.0 + invariants(gradient_at(corner, places[q]))[1]


@compiled
def cell_deformations(
    start: int, stop: int, cells: IntArray, displacement: FloatArray, gradients: FloatArray, places: FloatArray,
    out: FloatArray,
) -> None:
    """F of each cell at each of `places` into `out` (m, p, 3, 3)."""
    corner = np.empty((4, 9))
    for e in range(start, stop):
        vertex_gradients(cells[e], displacement, gradients[e], corner)
        for q in range(len(places)):
            h = gradient_at(corner, places[q])
            for i in range(3):
                for j in range(3):
                    out[e, q, i, j] = h[3 * i + j]
                out[e, q, i, i] += 1.0


@compiled
def cell_energies(
    start: int, stop: int, cells: IntArray, displacement: FloatArray, gradients: FloatArray, volumes: FloatArray,
    places: FloatArray, shares: FloatArray, kinds: AnyArray, mu: FloatArray, lam: FloatArray, out: FloatArray,
) -> None:
    """Energy of each cell [N mm] into `out` (m,), zero at rest."""
    corner = np.empty((4, 9))
    for e in range(start, stop):
        vertex_gradients(cells[e], displacement, gradients[e], corner)
        total = 0.0
        for q in range(len(places)):
            h = gradient_at(corner, places[q])
            total += shares[q] * density(kinds[e], mu[e], lam[e], h)
        out[e] = volumes[e] * total


@compiled
def cell_forces(
    start: int, stop: int, cells: IntArray, displacement: FloatArray, gradients: FloatArray, volumes: FloatArray,
    places: FloatArray, shares: FloatArray, kinds: AnyArray, mu: FloatArray, lam: FloatArray, out: FloatArray,
) -> None:
    """∂E/∂x_n of each cell [N] into `out` (m, 10, 3)."""
    f, cofactor, corner, moments = np.empty((3, 3)), np.empty((3, 3)), np.empty((4, 9)), np.empty((4, 3, 3))
    for e in range(start, stop):
        vertex_gradients(cells[e], displacement, gradients[e], corner)
        moments[:] = 0.0
        for q in range(len(places)):
            p = stress(kinds[e], mu[e], lam[e], gradient_at(corner, places[q]), f, cofactor)
            add_moments(p, places[q], shares[q] * volumes[e], moments)
        distribute_moments(moments, gradients[e], out[e])


@inlined
def add_moments(stress: Any, place: AnyArray, volume: Any, moments: AnyArray) -> None:
    """Add V λ_b P of a quadrature point, nine numbers row by row, to `moments` (4, 3, 3)."""
    s00, s01, s02, s10, s11, s12, s20, s21, s22 = stress
    for b in range(4):
        factor = volume * place[b]
        moments[b, 0, 0] += factor * s00
        moments[b, 0, 1] += factor * s01
        moments[b, 0, 2] += factor * s02
        moments[b, 1, 0] += factor * s10
        moments[b, 1, 1] += factor * s11
        moments[b, 1, 2] += factor * s12
        moments[b, 2, 0] += factor * s20
        moments[b, 2, 1] += factor * s21
        moments[b, 2, 2] += factor * s22


@inlined
def distribute_moments(moments: AnyArray, gradient: AnyArray, out: AnyArray) -> None:
    """Nodal forces of a cell into `out` (10, 3) from its stress moments S_b = ∫ λ_b P.

    ∫ P ∂N_a/∂X = (4 S_a − Σ_b S_b) G_a and ∫ P ∂N_ab/∂X = 4 (S_b G_a + S_a G_b).
    """
    for i in range(3):
        s0, s1, s2, s3 = moments[0, i], moments[1, i], moments[2, i], moments[3, i]
        t0, t1, t2 = s0[0] + s1[0] + s2[0] + s3[0], s0[1] + s1[1] + s2[1] + s3[1], s0[2] + s1[2] + s2[2] + s3[2]
        for a in range(4):
            s = moments[a, i]
            v0, v1, v2 = s[0] + s[0], s[1] + s[1], s[2] + s[2]
            out[a, i] = (
                (v0 + v0 - t0) * gradient[a, 0] + (v1 + v1 - t1) * gradient[a, 1] + (v2 + v2 - t2) * gradient[a, 2]
            )
        for pair in range(6):
            a, b = LOCAL_PAIRS[pair, 0], LOCAL_PAIRS[pair, 1]
            s, t = moments[a, i], moments[b, i]
            total = (
                t[0] * gradient[a, 0] + t[1] * gradient[a, 1] + t[2] * gradient[a, 2]
                + s[0] * gradient[b, 0] + s[1] * gradient[b, 1] + s[2] * gradient[b, 2]
            )
            total += total
            out[4 + pair, i] = total + total


@compiled
def cell_blocks(
    start: int, stop: int, cells: IntArray, displacement: FloatArray, gradients: FloatArray, volumes: FloatArray,
    places: FloatArray, shares: FloatArray, kinds: AnyArray, mu: FloatArray, lam: FloatArray, project: bool,
    out: FloatArray,
) -> None:
    """Stiffness ∂²E/∂x_n ∂x_m of the pairs `NODE_PAIRS` [N/mm] into `out` (m, 45, 3, 3).

    `project` lifts the negative eigenvalues of ∂P/∂F at each quadrature point to zero.
    """
    f, cofactor, fg, cg = np.empty((3, 3)), np.empty((3, 3)), np.empty((4, 3)), np.empty((4, 3))
    modes, shifts, work = np.empty((9, 3, 3)), np.empty(9), np.empty((6, 3, 3))
    corner, blocks = np.empty((4, 9)), np.empty((6, 3, 3))
    full, half, flat = np.empty((4, 4, 9)), np.empty((4, 10, 9)), out.reshape(len(out), 45, 9)
    for e in range(start, stop):
        flat[e] = 0.0
        vertex_gradients(cells[e], displacement, gradients[e], corner)
        for q in range(len(places)):
            h = gradient_at(corner, places[q])
            tangent_blocks(
                kinds[e], mu[e], lam[e], h, gradients[e], volumes[e] * shares[q], project, f, cofactor, fg, cg, modes,
                shifts, work, blocks,
            )
            spread_blocks(blocks, places[q], full, half, flat[e])


@compiled
def spread_blocks(
    blocks: FloatArray, place: FloatArray, full: FloatArray, half: FloatArray, out: FloatArray,
) -> None:
    """Add Σ_cd B_nc K_cd B_md for the vertex blocks K (6, 3, 3) of a quadrature point to `out` (45, 9).

    `full` (4, 4, 9) and `half` (4, 10, 9) are scratch.
    """
    for pair in range(6):
        a, b = LOCAL_PAIRS[pair, 0], LOCAL_PAIRS[pair, 1]
        for i in range(3):
            for j in range(3):
                full[a, b, 3 * i + j] = blocks[pair, i, j]
                full[b, a, 3 * j + i] = blocks[pair, i, j]
    for a in range(4):  # Σ_b K_ab = 0
        b, c, d = (a + 1) % 4, (a + 2) % 4, (a + 3) % 4
        for k in range(9):
            full[a, a, k] = -(full[a, b, k] + full[a, c, k] + full[a, d, k])
    for c in range(4):  # K Bᵀ
        for m in range(4):
            factor = 4.0 * place[m] - 1.0
            for k in range(9):
                half[c, m, k] = factor * full[c, m, k]
        for pair in range(6):
            a, b = LOCAL_PAIRS[pair, 0], LOCAL_PAIRS[pair, 1]
            one, other = 4.0 * place[b], 4.0 * place[a]
            for k in range(9):
                half[c, 4 + pair, k] = one * full[c, a, k] + other * full[c, b, k]
    at = 0
    for n in range(4):  # B (K Bᵀ), pairs n < m in the order of NODE_PAIRS
        factor = 4.0 * place[n] - 1.0
        for m in range(n + 1, 10):
            for k in range(9):
                out[at, k] += factor * half[n, m, k]
            at += 1
    for pair in range(6):
        a, b = LOCAL_PAIRS[pair, 0], LOCAL_PAIRS[pair, 1]
        one, other = 4.0 * place[b], 4.0 * place[a]
        for m in range(5 + pair, 10):
            for k in range(9):
                out[at, k] += one * half[a, m, k] + other * half[b, m, k]
            at += 1
