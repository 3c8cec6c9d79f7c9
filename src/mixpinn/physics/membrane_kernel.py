"""Energy, forces and stiffness of a membrane on the faces of a mesh, as compiled code; see `mixpinn.physics.membrane`.

Operands of all: `faces`, the nodes of each face, shape (f, k); `points`, where they are now [mm], shape (n, 3);
`gradients` of their shape functions in the plane of the face at rest [1/mm], shape (f, q, k, 2); `weights`, the area at
rest of each of the q quadrature points [mm²], shape (f, q); μh and γ [N/mm].
"""

from math import sqrt

import numpy as np
from numba import njit

from mixpinn.base.arrays import AnyArray, FloatArray, IntArray


@njit(cache=True, nogil=True)
def _deform(
    face: IntArray, points: FloatArray, gradients: FloatArray, f: FloatArray, inverse: FloatArray,
) -> float:
    """F = Σ x_a ⊗ ∇N_a into `f` (3, 2), the inverse of C = Fᵀ F into `inverse` (2, 2); returns J = √det C."""
    f[:] = 0.0
    for a in range(len(face)):
        for d in range(3):
            x = points[face[a], d]
            f[d, 0] += x * gradients[a, 0]
            f[d, 1] += x * gradients[a, 1]
    c00, c01, c11 = 0.0, 0.0, 0.0
    for d in range(3):
        c00 += f[d, 0] * f[d, 0]
        c01 += f[d, 0] * f[d, 1]
        c11 += f[d, 1] * f[d, 1]
    det = max(c00 * c11 - c01 * c01, 1e-12)
    inverse[0, 0], inverse[1, 1] = c11 / det, c00 / det
    inverse[0, 1] = -c01 / det
    inverse[1, 0] = -c01 / det
    return sqrt(det)


@njit(cache=True, nogil=True)
def membrane_energy(
    faces: IntArray, points: FloatArray, gradients: FloatArray, weights: FloatArray, shear: float, tension: float,
) -> float:
    """Σ w [½ μh (tr C + J⁻² − 3) + γ (J − 1)] [N mm]."""
    f, inverse = np.empty((3, 2)), np.empty((2, 2))
    energy = 0.0
    for i in range(len(faces)):
        for q in range(weights.shape[1]):
            stretch = _deform(faces[i], points, gradients[i, q], f, inverse)
            trace = 0.0
            for d in range(3):
                trace += f[d, 0] ** 2 + f[d, 1] ** 2
            energy += weights[i, q] * (
                0.5 * shear * (trace + 1.0 / stretch**2 - 3.0) + tension * (stretch - 1.0)
            )
    return energy


@njit(cache=True, nogil=True)
def add_membrane_forces(
    faces: IntArray, points: FloatArray, gradients: FloatArray, weights: FloatArray, shear: float, tension: float,
    nodal: AnyArray,
) -> None:
    """Add ∂E/∂x_a = Σ w F S ∇N_a, S = μh (1 − J⁻² C⁻¹) + γ J C⁻¹, to `nodal` [N], shape (n, 3)."""
    f, inverse = np.empty((3, 2)), np.empty((2, 2))
    for i in range(len(faces)):
        for q in range(weights.shape[1]):
            grads = gradients[i, q]
            stretch = _deform(faces[i], points, grads, f, inverse)
            turned = tension * stretch - shear / stretch**2
            s00 = weights[i, q] * (shear + turned * inverse[0, 0])
            s11 = weights[i, q] * (shear + turned * inverse[1, 1])
            s01 = weights[i, q] * turned * inverse[0, 1]
            for d in range(3):
                p0, p1 = f[d, 0] * s00 + f[d, 1] * s01, f[d, 0] * s01 + f[d, 1] * s11
                for a in range(len(faces[i])):
                    nodal[faces[i, a], d] += p0 * grads[a, 0] + p1 * grads[a, 1]


@njit(cache=True, nogil=True)
def membrane_stiffness(
    faces: IntArray, points: FloatArray, gradients: FloatArray, weights: FloatArray, shear: float, tension: float,
    project: bool, blocks: FloatArray,
) -> None:
    """∂²E/∂x_a ∂x_b of the nodes of each face into `blocks` [N/mm], shape (f, k, k, 3, 3).

    With D = C⁻¹, u_a = D ∇N_a, m_a = F u_a, H = F D Fᵀ (the projection onto the face) and h_ab = ∇N_a · u_b,

        K_ab = w [ μh ((∇N_a · ∇N_b − J⁻² h_ab) 1 + J⁻² (2 m_a m_bᵀ + m_b m_aᵀ + h_ab H))
                 + γ J (h_ab (1 − H) + m_a m_bᵀ − m_b m_aᵀ) ].

    Projected, a face that is pressed together keeps no stiffness across itself from μh, whose share is then positive
    semi-definite. That of the tension stays as it is: it is small beside the tissue's under it, and right at rest.
    """
    count = faces.shape[1]
    f, inverse, flat = np.empty((3, 2)), np.empty((2, 2)), np.empty((3, 3))
    m, u = np.empty((count, 3)), np.empty((count, 2))
    blocks[:] = 0.0
    for i in range(len(faces)):
        for q in range(weights.shape[1]):
            grads = gradients[i, q]
            stretch = _deform(faces[i], points, grads, f, inverse)
            for a in range(count):
                u[a, 0] = inverse[0, 0] * grads[a, 0] + inverse[0, 1] * grads[a, 1]
                u[a, 1] = inverse[0, 1] * grads[a, 0] + inverse[1, 1] * grads[a, 1]
                for d in range(3):
                    m[a, d] = f[d, 0] * u[a, 0] + f[d, 1] * u[a, 1]
            for d in range(3):
                for e in range(3):
                    flat[d, e] = f[d, 0] * (inverse[0, 0] * f[e, 0] + inverse[0, 1] * f[e, 1]) + f[d, 1] * (
                        inverse[0, 1] * f[e, 0] + inverse[1, 1] * f[e, 1]
                    )
            thin = shear / stretch**2
            s00, s01, s11 = shear - thin * inverse[0, 0], -thin * inverse[0, 1], shear - thin * inverse[1, 1]
            if project:  # the positive part of the 2 × 2 stress of μh
                mean, half = 0.5 * (s00 + s11), 0.5 * (s00 - s11)
                radius = sqrt(half * half + s01 * s01)
                high, low = max(mean + radius, 0.0), max(mean - radius, 0.0)
                scale = (high - low) / (2.0 * radius) if radius > 0.0 else 0.0
                middle = 0.5 * (high + low)
                s00, s11, s01 = middle + scale * half, middle - scale * half, scale * s01
            w = weights[i, q]
            for a in range(count):
                for b in range(count):
                    h = grads[a, 0] * u[b, 0] + grads[a, 1] * u[b, 1]
                    straight = grads[a, 0] * (s00 * grads[b, 0] + s01 * grads[b, 1]) + grads[a, 1] * (
                        s01 * grads[b, 0] + s11 * grads[b, 1]
                    ) + tension * stretch * h
                    for d in range(3):
                        for e in range(3):
                            value = thin * (2.0 * m[a, d] * m[b, e] + m[b, d] * m[a, e])
                            value += (thin - tension * stretch) * h * flat[d, e]
                            value += tension * stretch * (m[a, d] * m[b, e] - m[b, d] * m[a, e])
                            if d == e:
                                value += straight
                            blocks[i, a, b, d, e] += w * value
