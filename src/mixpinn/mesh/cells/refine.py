"""Uniform refinement: the same geometry and labels with every edge halved."""

from dataclasses import replace

import numpy as np

from mixpinn.base.arrays import AnyArray, FloatArray
from mixpinn.records.mid_edges import edge_index, mid_edge_labels
from mixpinn.records.tissue_mesh import TissueMesh

_EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])
"""Edges of a cell; the middle of edge m is called 4 + m below."""
_CORNERS = np.array([[0, 4, 5, 6], [4, 1, 7, 8], [5, 7, 2, 9], [6, 8, 9, 3]])
"""The four cells at the corners, oriented as their parent."""
_DIAGONALS = np.array([[4, 9], [5, 8], [6, 7]])
"""Each joins the middles of two opposite edges."""
_INNER = np.array([
    [[4, 9, 7, 5], [4, 9, 8, 7], [4, 9, 6, 8], [4, 9, 5, 6]],
    [[5, 8, 6, 4], [5, 8, 9, 6], [5, 8, 7, 9], [5, 8, 4, 7]],
    [[6, 7, 8, 4], [6, 7, 9, 8], [6, 7, 5, 9], [6, 7, 4, 5]],
])
"""The four cells of the octahedron that is left, for each of its diagonals."""


def refine(mesh: TissueMesh) -> TissueMesh:
    """Cut each cell into eight at the middles of its edges, which stay straight.

    Every boundary face becomes four in its own plane, so that the geometry is the same. Four cells at the corners are
    similar to their parent; the octahedron between them is cut along its shortest diagonal, which keeps it
    stocky. The middle of an edge is labelled by `mid_edge_labels`, a cell by its parent's
    tissue.

    Args:
        mesh: with n nodes and e edges.

    Returns:
        A mesh with n + e nodes: the first n are those of `mesh`, node n + i is the middle of ``mesh.edges[i]``. Cell c
        of `mesh` becomes the cells 8 c … 8 c + 7.
    """
    middles = mesh.points[mesh.edges].mean(axis=1)
    points = np.concatenate([mesh.points, middles])
    nodes = np.concatenate([mesh.cells, mesh.n_points + edge_index(mesh, mesh.cells[:, _EDGES])], axis=1)
    part, fixed = mid_edge_labels(mesh)
    inner = _INNER[_shortest_diagonal(points, nodes)].reshape(-1, 16)
    corners = np.broadcast_to(_CORNERS.ravel(), (len(nodes), 16))
    cells = np.take_along_axis(nodes, np.concatenate([corners, inner], axis=1), axis=1).reshape(-1, 4)
    return replace(
        mesh, points=points, cells=cells.astype(np.int32), part=np.concatenate([mesh.part, part]),
        fixed=np.concatenate([mesh.fixed, fixed]), tissue=np.repeat(mesh.tissue, 8),
    )


def _shortest_diagonal(points: FloatArray, nodes: AnyArray) -> AnyArray:
    """Which of `_DIAGONALS` is shortest in each cell; among equals the first. Shape (m,)."""
    ends = points[nodes[:, _DIAGONALS]]  # (m, 3, 2, 3)
    length = np.linalg.norm(ends[:, :, 0] - ends[:, :, 1], axis=2)
    shortest: AnyArray = (length <= length.min(axis=1, keepdims=True) * (1.0 + 1e-9)).argmax(axis=1)
    return shortest
