"""Nodal forces of the Stable Neo-Hookean material in single precision: the fast path of every prediction.

The law and the cells are those of `mixpinn.physics.energies`, `linear_tetrahedron` and `quadratic_tetrahedron`, which
solves use in double precision. Cells are summed at the nodes one after another, without threads and without work arrays
that outlive a call: any number of callers may run it at once, and the result is always the same.

Numba caches each file on its own: after a change of those three this file's cache must be renewed too (touch it, or
delete ``__pycache__``).
"""

import numpy as np
from numba import njit

from mixpinn.base.arrays import Float32Array, Int32Array
from mixpinn.physics.energies import nodal_force, stable_stress
from mixpinn.physics.linear_tetrahedron import displacement_gradient
from mixpinn.physics.quadratic_tetrahedron import add_moments, distribute_moments, gradient_at, vertex_gradients


@njit(fastmath=True, cache=True, nogil=True, error_model="numpy")
def add_stable_forces(
    cells: Int32Array, moved: Float32Array, gradients: Float32Array, volume: Float32Array, mu: Float32Array,
    lam: Float32Array, out: Float32Array,
) -> None:
    """Add V P G_a [N] of all four nodes of each cell to the nodal forces `out`.

    Args:
        cells: shape (m, 4).
        moved: displacement of the nodes [mm], shape (n, 3).
        gradients: G_a of each cell at rest [1/mm], shape (m, 4, 3).
        volume: of each cell [mm³], shape (m,).
        mu, lam: Lamé constants of each cell [N/mm²], shape (m,).
        out: shape (n, 3).
    """
    zero = np.float32(0.0)
    for e in range(len(cells)):
        gradient, v = gradients[e], volume[e]
        stress = stable_stress(displacement_gradient(cells[e], moved, gradient), mu[e], lam[e])
        t0, t1, t2 = zero, zero, zero
        for a in range(1, 4):
            f0, f1, f2 = nodal_force(stress, gradient, a)
            node = cells[e, a]
            out[node, 0] += v * f0
            out[node, 1] += v * f1
            out[node, 2] += v * f2
            t0, t1, t2 = t0 + f0, t1 + f1, t2 + f2
        node = cells[e, 0]
        out[node, 0] -= v * t0
        out[node, 1] -= v * t1
        out[node, 2] -= v * t2


@njit(fastmath=True, cache=True, nogil=True, error_model="numpy")
def add_quadratic_stable_forces(
    cells: Int32Array, moved: Float32Array, gradients: Float32Array, volume: Float32Array, mu: Float32Array,
    lam: Float32Array, places: Float32Array, shares: Float32Array, out: Float32Array,
) -> None:
    """Add ∫ P ∂N_n/∂X [N] of all ten nodes of each cell to the nodal forces `out`.

    Args:
        cells: vertices and the midpoints of the pairs `LOCAL_PAIRS`, shape (m, 10).
        moved, gradients, volume, mu, lam, out: as in `add_stable_forces`.
        places, shares: points and weights of a quadrature, shapes (p, 4) and (p,).
    """
    corner, moments = np.empty((4, 9), np.float32), np.empty((4, 3, 3), np.float32)
    forces = np.empty((10, 3), np.float32)
    for e in range(len(cells)):
        vertex_gradients(cells[e], moved, gradients[e], corner)
        moments[:] = np.float32(0.0)
        for q in range(len(places)):
            stress = stable_stress(gradient_at(corner, places[q]), mu[e], lam[e])
            add_moments(stress, places[q], shares[q] * volume[e], moments)
        distribute_moments(moments, gradients[e], forces)
        for n in range(10):
            for i in range(3):
                out[cells[e, n], i] += forces[n, i]
