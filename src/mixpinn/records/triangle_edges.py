"""Edges of triangle surfaces: which there are, and how many triangles share each."""

import numpy as np

from mixpinn.base.arrays import IntArray


def edge_uses(triangles: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """The edges of a surface, how many triangles each has, and how many of these run along it.

    Args:
        triangles: shape (t, 3).

    Returns:
        edges, lower vertex first, shape (e, 2); triangles of each, shape (e,); those that take its vertices in this
        order, shape (e,): one of the two where they face the same way.
    """
    directed = np.concatenate([triangles[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 0))])
    edges, place, faces = np.unique(np.sort(directed, axis=1), axis=0, return_inverse=True, return_counts=True)
    along = np.bincount(place.ravel()[directed[:, 0] < directed[:, 1]], minlength=len(edges))
    return edges, faces, along


def border_edges(triangles: IntArray) -> IntArray:
    """Edges that one triangle alone has, lower vertex first, shape (b, 2)."""
    edges, faces, _ = edge_uses(triangles)
    return edges[faces == 1]
