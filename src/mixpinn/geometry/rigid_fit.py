"""Rigid fit: the rotation that takes one set of points nearest to another."""

import numpy as np

from mixpinn.base.arrays import FloatArray


def fit_rotation(rest: FloatArray, moved: FloatArray) -> FloatArray:
    """Rotation R that minimises Σ |R (xᵢ − x̄) − (yᵢ − ȳ)|², shape (3, 3).

    Kabsch (1976): with the singular value decomposition Σ (xᵢ − x̄)(yᵢ − ȳ)ᵀ = U S Vᵀ, R = V diag(1, 1, det V Uᵀ) Uᵀ.

    Args:
        rest: xᵢ [mm], shape (n, 3).
        moved: yᵢ [mm], shape (n, 3).
    """
    covariance = (rest - rest.mean(axis=0)).T @ (moved - moved.mean(axis=0))
    u, _, vt = np.linalg.svd(covariance)
    sign = np.sign(np.linalg.det(vt.T @ u.T))
    rotation: FloatArray = vt.T @ np.diag([1.0, 1.0, sign]) @ u.T
    return rotation
