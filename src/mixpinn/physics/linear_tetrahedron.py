"""Compiled element kernels of linear tetrahedra: energy, nodal forces and stiffness blocks, cell by cell.

Each kernel fills the entries ``start:stop`` of its output, releases the GIL and writes nothing else, so that ranges may
run in threads and the result does not depend on how many. Shapes, for m cells and n nodes: ``cells`` (m, 4) node ids,
``displacement`` (n, 3) [mm], ``gradients`` (m, 4, 3) rest gradients G_a of the shape functions [1/mm], ``volumes`` (m,)
[mm³], ``kinds`` (m,) material codes of `mixpinn.physics.energies`, ``mu`` and ``lam`` (m,) [N/mm²].

Numba caches each file on its own: after a change of `mixpinn.physics.energies` or `projection` this file's cache must
be renewed too (touch it, or delete ``__pycache__``).
"""

from typing import Any

import numpy as np

from mixpinn.base.arrays import AnyArray, FloatArray, IntArray
from mixpinn.physics.energies import compiled, density, distribute, invariants, stress, tangent_blocks


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
def cell_jacobians(
    start: int, stop: int, cells: IntArray, displacement: FloatArray, gradients: FloatArray, out: FloatArray,
) -> None:
    """J = det F of each cell into `out` (m,)."""
    for e in range(start, stop):
        out[e] = 1.0 + invariants(_displacement_gradient(cells[e], displacement, gradients[e]))[1]


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
        out[e] = volumes[e] * density(kinds[e], mu[e], lam[e], h)


@compiled
def cell_forces(
    start: int, stop: int, cells: IntArray, displacement: FloatArray, gradients: FloatArray, volumes: FloatArray,
    kinds: AnyArray, mu: FloatArray, lam: FloatArray, out: FloatArray,
) -> None:
    """∂E/∂x_a = V P G_a of each cell [N] into `out` (m, 4, 3)."""
    f, p = np.empty((3, 3)), np.empty((3, 3))
    for e in range(start, stop):
        h = _displacement_gradient(cells[e], displacement, gradients[e])
        stress(kinds[e], mu[e], lam[e], h, f, p)
        distribute(p, gradients[e], volumes[e], out[e])


@compiled
def cell_blocks(
    start: int, stop: int, cells: IntArray, displacement: FloatArray, gradients: FloatArray, volumes: FloatArray,
    kinds: AnyArray, mu: FloatArray, lam: FloatArray, project: bool, out: FloatArray,
) -> None:
    """Stiffness ∂²E/∂x_a ∂x_b of the pairs `LOCAL_PAIRS` [N/mm] into `out` (m, 6, 3, 3).

    `project` lifts the negative eigenvalues of ∂P/∂F to zero.
    """
    f, cofactor, fg, cg = np.empty((3, 3)), np.empty((3, 3)), np.empty((4, 3)), np.empty((4, 3))
    modes, shifts, work = np.empty((9, 3, 3)), np.empty(9), np.empty((6, 3, 3))
    for e in range(start, stop):
        gradient, volume, block = gradients[e], volumes[e], out[e]
        h = _displacement_gradient(cells[e], displacement, gradient)
        tangent_blocks(
            kinds[e], mu[e], lam[e], h, gradient, volume, project, f, cofactor, fg, cg, modes, shifts, work, block,
        )
