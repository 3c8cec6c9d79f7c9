"""Linear tetrahedra: gradients of their shape functions."""

import numpy as np

from mixpinn.base.arrays import AnyArray, FloatArray
from mixpinn.records.tetrahedra import signed_volumes


def shape_gradients(points: FloatArray, cells: AnyArray) -> tuple[FloatArray, FloatArray]:
    """Gradients G_a of the linear shape functions and volumes, whatever the orientation of the cells.

    With the edges e_a from node 0 and their determinant D, G_1 = (e_2 × e_3)/D and cyclic; Σ_a G_a = 0.

    Args:
        points: [mm], shape (n, 3).
        cells: shape (m, 4).

    Returns:
        Gradients [1/mm], shape (m, 4, 3); volumes [mm³], shape (m,).
    """
    corners = points[cells]
    edges = corners[:, 1:] - corners[:, :1]
    volumes = signed_volumes(points, cells)
    gradients = np.empty((len(cells), 4, 3))
    for a in range(3):
        across = np.cross(edges[:, (a + 1) % 3], edges[:, (a + 2) % 3])
        gradients[:, a + 1] = across / (6.0 * volumes[:, None])
    gradients[:, 0] = -gradients[:, 1:].sum(axis=1)
    return gradients, np.abs(volumes)
