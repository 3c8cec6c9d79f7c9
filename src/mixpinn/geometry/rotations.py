"""Finite rotations: the exponential map, its inverse, turns about y, and the nearest rotation of a matrix."""

import numpy as np

from mixpinn.base.arrays import AnyArray, FloatArray


def skew(vectors: FloatArray) -> FloatArray:
    """Matrices [v] with [v] a = v × a.

    Args:
        vectors: shape (..., 3).

    Returns:
        Shape (..., 3, 3).
    """
    vectors = np.asarray(vectors, dtype=np.float64)
    found = np.zeros((*vectors.shape, 3))
    for i, (j, k) in enumerate(((1, 2), (2, 0), (0, 1))):
        found[..., k, j], found[..., j, k] = vectors[..., i], -vectors[..., i]
    return found


def rotation_from_vector(vectors: FloatArray) -> FloatArray:
    """Rotation matrices exp([w]) by Rodrigues' formula.

    exp([w]) = 1 + sin θ/θ [w] + (1 − cos θ)/θ² [w]², θ = |w|; the second factor is written as ½ (sin(θ/2)/(θ/2))²,
    which loses no digits for small angles.

    Args:
        vectors: rotation vectors w [rad], shape (..., 3).

    Returns:
        Shape (..., 3, 3).
    """
    vectors = np.asarray(vectors, dtype=np.float64)
    angle = np.linalg.norm(vectors, axis=-1)[..., None, None]
    generator = skew(vectors)
    # np.sinc(t) = sin(π t)/(π t), 1 at zero
    first, second = np.sinc(angle / np.pi), 0.5 * np.sinc(0.5 * angle / np.pi) ** 2
    rotation: FloatArray = np.eye(3) + first * generator + second * (generator @ generator)
    return rotation


def vector_from_rotation(rotations: FloatArray) -> FloatArray:
    """Rotation vectors w with exp([w]) = R, |w| ≤ π: the inverse of `rotation_from_vector`.

    Goes through the unit quaternion of largest component (Shepperd 1978), accurate for every angle.

    Args:
        rotations: shape (..., 3, 3).

    Returns:
        Rotation vectors [rad], shape (..., 3).
    """
    r = np.asarray(rotations, dtype=np.float64)
    trace = np.trace(r, axis1=-2, axis2=-1)
    # 4 q qᵀ for the quaternion q = (w, x, y, z): any row is a multiple of q, the one of largest diagonal is safest.
    table = np.empty((*r.shape[:-2], 4, 4))
    table[..., 0, 0] = 1.0 + trace
    for i, (j, k) in enumerate(((1, 2), (2, 0), (0, 1))):
        table[..., i + 1, i + 1] = 1.0 + 2.0 * r[..., i, i] - trace
        table[..., 0, i + 1] = table[..., i + 1, 0] = r[..., k, j] - r[..., j, k]
        table[..., j + 1, k + 1] = table[..., k + 1, j + 1] = r[..., k, j] + r[..., j, k]
    largest = np.argmax(np.diagonal(table, axis1=-2, axis2=-1), axis=-1)
    quaternion = np.take_along_axis(table, largest[..., None, None], axis=-2)[..., 0, :]
    quaternion = quaternion / np.linalg.norm(quaternion, axis=-1, keepdims=True)
    quaternion = np.where(quaternion[..., :1] < 0.0, -quaternion, quaternion)
    sine = np.linalg.norm(quaternion[..., 1:], axis=-1, keepdims=True)
    half_angle = np.arctan2(sine, quaternion[..., :1])
    # w = θ · axis = 2 (θ/2) / sin(θ/2) · (x, y, z)
    vector: FloatArray = 2.0 / np.sinc(half_angle / np.pi) * quaternion[..., 1:]
    return vector


def rotation_about_y(angle_deg: AnyArray | float) -> FloatArray:
    """Right-handed rotations about +y.

    Args:
        angle_deg: [degree], any shape (...).

    Returns:
        Shape (..., 3, 3).
    """
    angle = np.deg2rad(np.asarray(angle_deg, dtype=np.float64))
    turn = np.zeros((*angle.shape, 3, 3))
    turn[..., 0, 0] = turn[..., 2, 2] = np.cos(angle)
    turn[..., 0, 2], turn[..., 2, 0] = np.sin(angle), -np.sin(angle)
    turn[..., 1, 1] = 1.0
    return turn


def orthonormalise(rotations: FloatArray) -> FloatArray:
    """Nearest rotation matrices: removes the rounding errors of long products; shape (..., 3, 3)."""
    u, _, vt = np.linalg.svd(rotations)
    u[..., :, 2] *= np.sign(np.linalg.det(u @ vt))[..., None]
    nearest: FloatArray = u @ vt
    return nearest
