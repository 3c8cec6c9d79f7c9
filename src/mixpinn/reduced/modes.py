"""Principal modes of differences between fields, in reduced coordinates."""

from typing import Any

import numpy as np

from mixpinn.base.arrays import AnyArray, Float32Array


def principal_modes(
    differences: AnyArray, weights: Float32Array, n_modes: int, *, rng: np.random.Generator,
) -> Float32Array:
    """The leading principal modes, orthonormal in the displacement of nodes: Σ_d w_d² ψ_id ψ_jd = δ_ij.

    A randomised singular value decomposition with three power iterations (N. Halko, P. G. Martinsson and J. A. Tropp,
    SIAM Review 53, 2011).

    Args:
        differences: of reduced unknowns, one a row [mm, rad], shape (S, D).
        weights: `ReducedCoordinates.weights`, shape (D,).
        n_modes: number of modes m; fewer come back where the rows span less.
        rng: draws the test vectors.

    Returns:
        Modes, float32, shape (m, D).
    """
    rows = np.asarray(differences, dtype=np.float32) * weights
    rank = min(n_modes + 16, *rows.shape)
    basis: Any = np.linalg.qr(rows.T @ rng.standard_normal((len(rows), rank)).astype(np.float32))[0]
    for _ in range(3):
        basis = np.linalg.qr(rows.T @ (rows @ basis))[0]
    _, size, mixing = np.linalg.svd(rows @ basis, full_matrices=False)
    kept = min(n_modes, int((size > 1e-6 * max(float(size[0]), 1e-30)).sum()))
    modes: Float32Array = ((basis @ mixing[:kept].T).T / weights).astype(np.float32)
    return modes


def coefficients(modes: Float32Array, weights: Float32Array, unknowns: AnyArray) -> Float32Array:
    """Coefficients of fields (S, D) in orthonormal modes (m, D), shape (S, m)."""
    scaled: AnyArray = np.asarray(unknowns, dtype=np.float32) * weights**2
    return scaled @ modes.T


def excited_modes(
    modes: Float32Array, weights: Float32Array, unknowns: AnyArray, *, least: float = 1e-3,
) -> Float32Array:
    """The modes (m, D) that fields (S, D) really excite: root mean square coefficient above `least` times the largest.

    A feature of hardly any size in the training samples would be scaled up to unit variance, and what was fitted to it
    blown up where a sample excites it. The default was chosen by hand.
    """
    size = np.sqrt(np.square(coefficients(modes, weights, unknowns)).mean(axis=0))
    return modes[size > least * size.max(initial=0.0)]
