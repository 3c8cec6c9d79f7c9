"""Faces of a finer mesh in those they were cut from: which one a point lies on, and its shape functions there."""

import numpy as np

from mixpinn.base.arrays import FloatArray, IntArray
from mixpinn.geometry.triangle_search import close_pairs
from mixpinn.records.tissue_mesh import FACE_EDGES

_ON = 1e-6
"""A point within this distance of a face lies on it [mm]; the finer nodes are middles of edges of it."""


def owning_faces(points: FloatArray, corners: FloatArray, faces: IntArray) -> IntArray:
    """A face on which each of some points lies.

    Args:
        points: [mm], shape (p, 3).
        corners: vertices of the faces [mm], shape (v, 3).
        faces: shape (f, 3).

    Returns:
        Of each point one face, shape (p,).
    """
    point, face = close_pairs(np.ascontiguousarray(points), corners, faces, _ON)
    found = np.full(len(points), -1, dtype=np.int64)
    found[point[::-1]] = face[::-1]
    assert (found >= 0).all()
    return found


def face_functions(points: FloatArray, corners: FloatArray, order: int) -> FloatArray:
    """Shape functions of faces with `corners` (p, 3, 3) at a point of each (p, 3), shape (p, 3) or (p, 6)."""
    first, second, to = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], points - corners[:, 0]
    normal = np.cross(first, second)
    whole = (normal**2).sum(axis=1)
    b = (np.cross(to, second) * normal).sum(axis=1) / whole
    c = (np.cross(first, to) * normal).sum(axis=1) / whole
    at = np.stack([1.0 - b - c, b, c], axis=1)
    if order == 1:
        return at
    return np.concatenate([at * (2.0 * at - 1.0), 4.0 * at[:, FACE_EDGES[:, 0]] * at[:, FACE_EDGES[:, 1]]], axis=1)
