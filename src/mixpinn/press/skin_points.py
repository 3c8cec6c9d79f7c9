"""SkinPoints: the places of the skin at which contact with a probe is asked for, each with a share of its area.

On faces of six nodes these are the points of the solver's own rule (`mixpinn.physics.face_points`), which move by the
face's shape functions: with the four flat triangles between its nodes instead, contact from the pose was a tenth
stiffer than the solver's, at any depth.
"""

from dataclasses import dataclass

import numpy as np

from mixpinn.base.arrays import FloatArray, IntArray
from mixpinn.physics.face_points import FacePoints


@dataclass(frozen=True, eq=False)
class SkinPoints:
    """Points fixed to the skin: each moves as the weighted sum of the nodes of its face, p points on t faces.

    The points of a face of three nodes are the centroids of the equal triangles into which it is divided, so that the
    sum over them is a quadrature over the face.

    Attributes:
        stencil: nodes of each point's face, shape (p, w).
        weights: of these nodes, shape (p, w).
        area: that the point stands for [mm²], shape (p,).
        face: of each point, ascending, shape (p,).
    """

    stencil: IntArray
    weights: FloatArray
    area: FloatArray
    face: IntArray

    @staticmethod
    def of_faces(points: FloatArray, faces: IntArray, *, spacing: float) -> "SkinPoints":
        """Points on parts, with edges of at most `spacing` [mm], of faces (t, 3), one each, or (t, 6), three each.

        `points` are the positions of the nodes [mm], shape (n, 3).
        """
        if faces.shape[1] == 3:
            return SkinPoints.of_triangles(points, faces, spacing=spacing)
        found = FacePoints.build(faces, points[faces[:, :3]], spacing=0.5 * spacing)
        return SkinPoints(
            np.ascontiguousarray(found.vertices, dtype=np.int64), np.ascontiguousarray(found.weights), found.area,
            found.face,
        )

    @staticmethod
    def of_triangles(points: FloatArray, triangles: IntArray, *, spacing: float) -> "SkinPoints":
        """Divide each triangle so that the edges of its parts are at most `spacing` long.

        Args:
            points: positions of the nodes [mm], shape (n, 3).
            triangles: shape (t, 3).
            spacing: [mm].
        """
        corners = points[triangles]
        edges = corners - np.roll(corners, 1, axis=1)
        longest = np.linalg.norm(edges, axis=2).max(axis=1, initial=0.0)
        parts = np.maximum(1, np.ceil(longest / spacing)).astype(np.int64)
        area = 0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
        patterns = {int(m): _centroids(int(m)) for m in np.unique(parts)}
        face = np.repeat(np.arange(len(triangles)), parts**2)
        weights = [patterns[int(m)] for m in parts]
        return SkinPoints(
            np.ascontiguousarray(triangles[face], dtype=np.int64),
            np.concatenate([*weights, np.empty((0, 3))]), (area / parts**2)[face], face,
        )

    def balls(self, places: FloatArray, faces: int) -> tuple[IntArray, FloatArray]:
        """Where the points of each of so many faces begin, and balls around them.

        Args:
            places: of the points [mm], shape (p, 3).
            faces: their number t; each has points.

        Returns:
            The first point of each face, and their number, shape (t + 1,); centre and radius [mm], shape (t, 4).
        """
        starts = np.searchsorted(self.face, np.arange(faces + 1))
        if not faces:
            return starts, np.empty((0, 4))
        centre = np.add.reduceat(places, starts[:-1]) / np.diff(starts)[:, None]
        radius = np.maximum.reduceat(np.linalg.norm(places - centre[self.face], axis=1), starts[:-1])
        return starts, np.concatenate([centre, radius[:, None]], axis=1)

    def on_faces(self, chosen: IntArray) -> IntArray:
        """The points of the chosen faces, ascending."""
        wanted = np.zeros(int(self.face.max(initial=-1)) + 1, dtype=bool)
        wanted[chosen] = True
        found: IntArray = np.flatnonzero(wanted[self.face])
        return found


def _centroids(m: int) -> FloatArray:
    """Barycentric coordinates of the centroids of the m² equal parts of a triangle, shape (m², 3)."""
    i, j = np.meshgrid(np.arange(m), np.arange(m), indexing="ij")
    upright, turned = i + j < m, i + j < m - 1
    first = np.concatenate([i[upright] + 1.0 / 3.0, i[turned] + 2.0 / 3.0]) / m
    second = np.concatenate([j[upright] + 1.0 / 3.0, j[turned] + 2.0 / 3.0]) / m
    return np.stack([first, second, 1.0 - first - second], axis=1)
