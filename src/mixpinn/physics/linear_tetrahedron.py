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
from mixpinn.physics.energies import compiled, density, distribute, inlined, invariants, stress, tangent_blocks


@inlined
def displacement_gradient(cell: AnyArray, displacement: AnyArray, gradient: AnyArray) -> Any:
    """H of a cell, nine numbers row by row, in the precision of its arguments.

    Σ_a G_a = 0, so that only differences to node 0 enter.
    """
    n0, n1, n2, n3 = cell[0], cell[1], cell[2], cell[3]
    u0, u1, u2 = displacement[n0, 0], displacement[n0, 1], displacement[n0, 2]
    a0, a1, a2 = displacement[n1, 0] - u0, displacement[n1, 1] - u1, displacement[n1, 2] - u2
    b0, b1, b2 = displacement[n2, 0] - u0, displacement[n2, 1] - u1, displacement[n2, 2] - u2
    c0, c1, c2 = displacement[n3, 0] - u0, displacement[n3, 1] - u1, displacement[n3, 2] - u2
    p0, p1, p2 = gradient[1, 0], gradient[1, 1], gradient[1, 2]
    q0, q1, q2 = gradient[2, 0], gradient[2, 1], gradient[2, 2]
    r0, r1, r2 = gradient[3, 0], gradient[3, 1], gradient[3, 2]
    return (
        a0 * p0 + b0 * q0 + c0 * r0, a0 * p1 + b0 * q1 + c0 * r1, a0 * p2 + b0 * q2 + c0 * r2,
        a1 * p0 + b1 * q0 + c1 * r0, a1 * p1 + b1 * q1 + c1 * r1, a1 * p2 + b1 * q2 + c1 * r2,
        a2 * p0 + b2 * q0 + c2 * r0, a2 * p1 + b2 * q1 + c2 * r1, a2 * p2 + b2 * q2 + c2 * r2,
    )


@compiled
def cell_jacobians(
    start: int, stop: int, cells: IntArray, displacement: FloatArray, gradients: FloatArray, out: FloatArray,
) -> None:
    """J = det F of each cell into `out` (m,)."""
    for e in range(start, stop):
        out[e] = 1.0 + invariants(displacement_gradient(cells[e], displacement, gradients[e]))[1]


@compiled
def cell_deformations(
    start: int, stop: int, cells: IntArray, displacement: FloatArray, gradients: FloatArray, out: FloatArray,
) -> None:
    """F of each cell into `out` (m, 3, 3)."""
    for e in range(start, stop):
        h = displacement_gradient(cells[e], displacement, gradients[e])
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
        h = displacement_gradient(cells[e], displacement, gradients[e])
        out[e] = volumes[e] * density(kinds[e], mu[e], lam[e], h)


@compiled
def cell_forces(
    start: int, stop: int, cells: IntArray, displacement: FloatArray, gradients: FloatArray, volumes: FloatArray,
    kinds: AnyArray, mu: FloatArray, lam: FloatArray, out: FloatArray,
) -> None:
    """∂E/∂x_a = V P G_a of each cell [N] into `out` (m, 4, 3)."""
    f, cofactor = np.empty((3, 3)), np.empty((3, 3))
    for e in range(start, stop):
        h = displacement_gradient(cells[e], displacement, gradients[e])
        distribute(stress(kinds[e], mu[e], lam[e], h, f, cofactor), gradients[e], volumes[e], out[e])


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
        h = displacement_gradient(cells[e], displacement, gradient)
        tangent_blocks(
            kinds[e], mu[e], lam[e], h, gradient, volume, project, f, cofactor, fg, cg, modes, shifts, work, block,
        )
