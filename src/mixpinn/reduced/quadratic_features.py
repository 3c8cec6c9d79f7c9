"""Features of second order: what responses of the body are corrected by."""

from functools import lru_cache

import numpy as np

from mixpinn.base.arrays import AnyArray, Float32Array, IntArray


def quadratic_features(coordinates: AnyArray) -> Float32Array:
    """[a, a_i a_j for i ≤ j], shape (…, k) → (…, k + k (k + 1) / 2); zero at zero."""
    first, second = _pairs(coordinates.shape[-1])
    joined: Float32Array = np.concatenate(
        [coordinates, coordinates[..., first] * coordinates[..., second]], axis=-1,
    ).astype(np.float32)
    return joined


@lru_cache
def _pairs(count: int) -> tuple[IntArray, IntArray]:
    """All i ≤ j: asked for with every prediction, and always the same."""
    first, second = np.triu_indices(count)
    return first, second
