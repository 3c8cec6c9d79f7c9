"""The skin as mesh nodes see it, and the patches of it on which contact is sought."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from mixpinn.base.arrays import FloatArray, IntArray
from mixpinn.base.errors import InputError
from mixpinn.geometry.proximity import Triangulation
from mixpinn.records import TissueMesh
from mixpinn.records.tissue_mesh import CELL_EDGES


@dataclass(frozen=True, eq=False)
class SkinSurface:
    """A triangle surface that follows the mesh: each vertex is a fixed weighted mean of mesh nodes.

    Attributes:
        nodes: mesh nodes behind each vertex, shape (v, w); w = 1 for the mesh's own skin.
        weights: their weights, shape (v, w), each row sums to one.
        surface: connectivity.
    """

    nodes: IntArray
    weights: FloatArray
    surface: Triangulation

    def vertices(self, points: FloatArray) -> FloatArray:
        """Vertex positions for mesh node positions `points`, shape (n, 3) [mm] → (v, 3) [mm]."""
        if self.nodes.shape[1] == 1:
            return points[self.nodes[:, 0]]
        return np.einsum("vw,vwk->vk", self.weights, points[self.nodes])

    @staticmethod
    def of_mesh(mesh: TissueMesh) -> "SkinSurface":
        """The mesh's own skin: its nodes, with the triangles between them."""
        vertices, triangles = np.unique(mesh.skin_triangles, return_inverse=True)
        triangles = triangles.reshape(-1, 3)
        return SkinSurface(
            vertices[:, None], np.ones((len(vertices), 1)), Triangulation.build(triangles, len(vertices)),
        )

    @staticmethod
    def embedded(mesh: TissueMesh, points: FloatArray, triangles: IntArray) -> "SkinSurface":
        """Another surface tied to the mesh: vertices that are nodes follow them, others their cell's nodes.

        In a ten-node cell they follow its quadratic shape functions.

        Args:
            mesh: the mesh to follow.
            points: rest positions of the vertices [mm], shape (v, 3); a vertex outside every cell follows the cell
                in which its barycentric weights are least negative.
            triangles: shape (t, 3).

        Raises:
            InputError: a vertex is farther than 20 mm from the mesh.
        """
        distance, nearest = cKDTree(mesh.points).query(points)
        corners = mesh.points[mesh.cells]
        inverse = np.linalg.inv(np.concatenate([corners, np.ones((len(corners), 4, 1))], axis=2).transpose(0, 2, 1))
        width = mesh.cell_nodes.shape[1]
        nodes = np.repeat(nearest[:, None], width, axis=1)
        weights = np.eye(1, width).repeat(len(points), axis=0)
        for vertex in np.flatnonzero(distance > 1e-3):
            barycentric = inverse @ np.append(points[vertex], 1.0)
            cell = int(barycentric.min(axis=1).argmax())
            if barycentric[cell].min() < -20.0:
                raise InputError(
                    "contact surface", expected="vertices on the mesh's skin", got=f"vertex {vertex} far from it",
                    fix="use a surface of the same anatomy and frame",
                )
            at = barycentric[cell]
            if mesh.order == 2:
                at = np.concatenate([at * (2.0 * at - 1.0), 4.0 * at[CELL_EDGES].prod(axis=1)])
            nodes[vertex], weights[vertex] = mesh.cell_nodes[cell], at
        return SkinSurface(nodes.astype(np.int64), weights, Triangulation.build(triangles, len(points)))


@dataclass(frozen=True, eq=False)
class SkinPatch:
    """Part of a skin.

    Attributes:
        vertices: skin vertices, ascending, shape (v,).
        triangles: those of the skin whose vertices are all in the patch, by index into `vertices`, shape (t, 3).
    """

    vertices: IntArray
    triangles: IntArray

    @staticmethod
    def of_vertices(skin: SkinSurface, vertices: IntArray) -> "SkinPatch":
        """The patch that has these vertices of `skin`, ascending."""
        local = np.full(len(skin.nodes), -1, dtype=np.int64)
        local[vertices] = np.arange(len(vertices))
        triangles = local[skin.surface.triangles]
        return SkinPatch(np.asarray(vertices, dtype=np.int64), triangles[(triangles >= 0).all(axis=1)])
