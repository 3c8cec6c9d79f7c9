"""Compiled nodal forces and stiffness blocks from stresses and tangents that were computed elsewhere.

The path of materials that are not compiled; conventions as in `mixpinn.physics.linear_tetrahedron`.
"""

from mixpinn.base.arrays import FloatArray
from mixpinn.physics.linear_tetrahedron import LOCAL_PAIRS, compiled, distribute


@compiled
def cell_forces_of_stress(
    start: int, stop: int, stress: FloatArray, gradients: FloatArray, volumes: FloatArray, out: FloatArray,
) -> None:
    """∂E/∂x_a = V P G_a for given stresses P (m, 3, 3)."""
    for e in range(start, stop):
        distribute(stress[e], gradients[e], volumes[e], out[e])


@compiled
def cell_blocks_of_tangent(
    start: int, stop: int, tangent: FloatArray, gradients: FloatArray, volumes: FloatArray, out: FloatArray,
) -> None:
    """Stiffness blocks for given tangents (m, 9, 9)."""
    for e in range(start, stop):
        for pair in range(6):
            a, b = LOCAL_PAIRS[pair, 0], LOCAL_PAIRS[pair, 1]
            for i in range(3):
                for k in range(3):
                    value = 0.0
                    for j in range(3):
                        for m in range(3):
                            value += gradients[e, a, j] * tangent[e, 3 * i + j, 3 * k + m] * gradients[e, b, m]
                    out[e, pair, i, k] = volumes[e] * value
