"""What every record of tetrahedra agrees on: the order of a cell's faces, and the sign of its volume."""

import numpy as np

from mixpinn.base.arrays import AnyArray, FloatArray

TETRA_FACES = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])
"""Faces of a positively oriented tetrahedron, each opposite its vertex, normals outward."""


def signed_volumes(points: FloatArray, cells: AnyArray) -> FloatArray:
    """Signed volume of each cell [mm³], shape (m,): (b − a) × (c − a) · (d − a) / 6.

    Args:
        points: [mm], shape (n, 3).
        cells: shape (m, 4).
    """
    a, b, c, d = np.moveaxis(points[cells], 1, 0)
    volumes: FloatArray = np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6.0
    return volumes
