"""Ridge regression: least squares with a penalty on the coefficients of scaled features."""

import numpy as np

from mixpinn.base.arrays import AnyArray, FloatArray


def ridge(
    features: AnyArray, targets: AnyArray, *, penalty: float, scale: AnyArray | float = 1.0,
) -> FloatArray:
    """Coefficients g that minimise |X g − Y|² + λ |s g|², with s the scale of each feature.

    With Z = X / s, g = (Zᵀ Z + λ 1)⁻¹ Zᵀ Y / s. There is no constant term.

    Args:
        features: X, shape (N, f).
        targets: Y, shape (N, o) or (N,).
        penalty: λ. Relative to the number of samples it is λ = N times that.
        scale: s, for example `column_norms` or `column_deviations`, shape (f,); 1 leaves the features as they are.

    Returns:
        Shape (f, o) or (f,).
    """
    x, y = np.asarray(features, dtype=np.float64), np.asarray(targets, dtype=np.float64)
    size = np.broadcast_to(np.asarray(scale, dtype=np.float64), x.shape[1:])
    rows = x / size
    normal = rows.T @ rows
    normal[np.diag_indices_from(normal)] += penalty
    gain: FloatArray = (np.linalg.solve(normal, rows.T @ y).T / size).T
    return gain


def column_norms(features: AnyArray) -> FloatArray:
    """Euclidean norm of each feature, shape (f,); scaled by it, Zᵀ Z has ones on its diagonal."""
    norms: FloatArray = np.linalg.norm(np.asarray(features, dtype=np.float64), axis=0) + 1e-30
    return norms


def column_deviations(features: AnyArray) -> FloatArray:
    """Standard deviation of each feature, shape (f,); no less than 1e-12."""
    deviations: FloatArray = np.maximum(np.asarray(features, dtype=np.float64).std(axis=0), 1e-12)
    return deviations
