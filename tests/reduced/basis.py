"""Principal modes of responses that count alike, whatever their size, and how far two sets of fields lie apart."""

import numpy as np

from mixpinn.base.arrays import AnyArray, Float32Array, FloatArray


def response_modes(responses: AnyArray, weights: Float32Array, n_modes: int) -> Float32Array:
    """The leading modes of responses, each scaled to norm 1, orthonormal: Σ_d w_d² ψ_id ψ_jd = δ_ij.

    Proper orthogonal decomposition by the method of snapshots (L. Sirovich, Quarterly of Applied Mathematics 45, 1987);
    a QR decomposition restores the orthogonality that single precision loses.

    Args:
        responses: of reduced unknowns, one a row [mm, rad], shape (N, D).
        weights: of the unknowns, shape (D,).
        n_modes: number of modes; fewer come back where the rows span less in single precision.

    Returns:
        Modes, float32, shape (r, D).
    """
    rows = np.asarray(responses, dtype=np.float32) * weights
    rows /= np.linalg.norm(rows, axis=1, keepdims=True) + 1e-30
    squared, vectors = np.linalg.eigh((rows @ rows.T).astype(np.float64))
    kept = min(n_modes, int((squared > 1e-10 * squared[-1]).sum()))
    leading = vectors[:, ::-1][:, :kept].T.astype(np.float32) @ rows
    orthogonal = np.linalg.qr(leading.T.astype(np.float64))[0]
    modes: Float32Array = np.ascontiguousarray(orthogonal.T / weights, dtype=np.float32)
    return modes


def unlike(found: AnyArray, fields: AnyArray, weights: Float32Array) -> FloatArray:
    """|found − field| / |field| of each of the fields (S, D) in the norm of the weights, shape (S,)."""
    apart = np.linalg.norm((found - fields) * weights, axis=1)
    return np.asarray(apart / np.linalg.norm(fields * weights, axis=1), dtype=np.float64)
