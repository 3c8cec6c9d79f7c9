"""Compiled nodal forces and stiffness blocks from stresses and tangents that were computed elsewhere.

The path of materials that are not compiled; conventions as in `mixpinn.physics.linear_tetrahedron` and
`quadratic_tetrahedron`.
"""

import numpy as np

from mixpinn.base.arrays import FloatArray
from mixpinn.physics.energies import LOCAL_PAIRS, compiled, distribute, entries
from mixpinn.physics.quadratic_tetrahedron import add_moments, distribute_moments, spread_blocks


@compiled
def cell_forces_of_stress(
    start: int, stop: int, stress: FloatArray, gradients: FloatArray, volumes: FloatArray, out: FloatArray,
) -> None:
    """∂E/∂x_a = V P G_a for given stresses P (m, 3, 3)."""
    for e in range(start, stop):
        distribute(entries(stress[e]), gradients[e], volumes[e], out[e])


@compiled
def _contract(tangent: FloatArray, gradient: FloatArray, volume: float, out: FloatArray) -> None:
    for pair in range(6):
        a, b = LOCAL_PAIRS[pair, 0], LOCAL_PAIRS[pair, 1]
        for i in range(3):
            for k in range(3):
                value = 0.0
                for j in range(3):
                    for m in range(3):
                        value += gradient[a, j] * tangent[3 * i + j, 3 * k + m] * gradient[b, m]
                out[pair, i, k] = volume * value


@compiled
def cell_blocks_of_tangent(
    start: int, stop: int, tangent: FloatArray, gradients: FloatArray, volumes: FloatArray, out: FloatArray,
) -> None:
    """Stiffness blocks for given tangents (m, 9, 9)."""
    for e in range(start, stop):
        _contract(tangent[e], gradients[e], volumes[e], out[e])


@compiled
def quadratic_forces_of_stress(
    start: int, stop: int, stress: FloatArray, gradients: FloatArray, volumes: FloatArray, places: FloatArray,
    shares: FloatArray, out: FloatArray,
) -> None:
    """Nodal forces (m, 10, 3) of ten-node cells for given stresses P (m, p, 3, 3) at the quadrature points."""
    moments = np.empty((4, 3, 3))
    for e in range(start, stop):
        moments[:] = 0.0
        for q in range(len(places)):
            add_moments(entries(stress[e, q]), places[q], shares[q] * volumes[e], moments)
        distribute_moments(moments, gradients[e], out[e])


@compiled
def quadratic_blocks_of_tangent(
    start: int, stop: int, tangent: FloatArray, gradients: FloatArray, volumes: FloatArray, places: FloatArray,
    shares: FloatArray, out: FloatArray,
) -> None:
    """Stiffness blocks (m, 45, 3, 3) of ten-node cells for given tangents (m, p, 9, 9)."""
    blocks, full, half = np.empty((6, 3, 3)), np.empty((4, 4, 9)), np.empty((4, 10, 9))
    flat = out.reshape(len(out), 45, 9)
    for e in range(start, stop):
        flat[e] = 0.0
        for q in range(len(places)):
            _contract(tangent[e, q], gradients[e], volumes[e] * shares[q], blocks)
            spread_blocks(blocks, places[q], full, half, flat[e])
