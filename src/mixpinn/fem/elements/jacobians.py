"""Change of volume of the cells of a mesh under a displacement, without an elastic system."""

import numpy as np

from mixpinn.base.arrays import AnyArray, FloatArray
from mixpinn.geometry.tetrahedra import shape_gradients
from mixpinn.physics import linear_tetrahedron, quadratic_tetrahedron
from mixpinn.physics.quadrature import TETRAHEDRON_4
from mixpinn.records import TissueMesh


def smallest_jacobians(mesh: TissueMesh, displacement: AnyArray, *, places: FloatArray | None = None) -> FloatArray:
    """Smallest det F of each cell over some of its points, shape (m,); a linear cell has one det F.

    Args:
        mesh: the mesh.
        displacement: of every node [mm], shape (n_nodes, 3).
        places: barycentric coordinates of the points of ten-node cells, shape (p, 4); by default those of their
            quadrature.
    """
    nodes, moved = np.sort(mesh.cell_nodes, axis=1), np.asarray(displacement, dtype=np.float64)
    gradients, _ = shape_gradients(mesh.points, nodes[:, :4])
    if mesh.order == 1:
        values = np.empty(len(nodes))
        linear_tetrahedron.cell_jacobians(0, len(nodes), nodes, moved, gradients, values)
        return values
    at = TETRAHEDRON_4.points if places is None else places
    values = np.empty((len(nodes), len(at)))
    quadratic_tetrahedron.cell_jacobians(0, len(nodes), nodes, moved, gradients, at, values)
    return values.min(axis=1)
