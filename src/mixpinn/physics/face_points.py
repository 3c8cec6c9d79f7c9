"""Points on the faces of a skin over which the gap law is integrated."""

from dataclasses import dataclass

import numpy as np

from mixpinn.base.arrays import FloatArray, IntArray
from mixpinn.physics.quadrature import TRIANGLE_3
from mixpinn.records.tissue_mesh import FACE_EDGES

_MOST_CUTS = 16
"""Large n would fill the memory with points on large faces that nothing ever touches."""


@dataclass(frozen=True, eq=False)
class FacePoints:
    """Quadrature points on faces of three or six vertices each; p points on f faces.

    Attributes:
        faces: vertices of the skin at each face, shape (f, 3) or (f, 6).
        face: face of each point, ascending, shape (p,).
        weights: shape functions of the face's vertices at each point, shape (p, 3) or (p, 6).
        area: rest area that each point stands for [mm²], shape (p,).
    """

    faces: IntArray
    face: IntArray
    weights: FloatArray
    area: FloatArray

    def __len__(self) -> int:
        return len(self.area)

    @property
    def vertices(self) -> IntArray:
        """Vertices of the skin behind each point, shape (p, 3) or (p, 6)."""
        return self.faces[self.face]

    @staticmethod
    def build(faces: IntArray, corners: FloatArray, *, spacing: float) -> "FacePoints":
        """Cut each flat face into n² equal triangles with three points each, about `spacing` apart.

        The rule is exact for polynomials of degree two on each of these triangles, and so for the loads of six-node
        faces under uniform pressure. On a face with edges longer than 2 `_MOST_CUTS` spacings the points lie farther
        apart: 64 mm at a spacing of 2 mm, which skin that a probe is to touch stays far below.

        Args:
            faces: vertices of each face, shape (f, 3), or (f, 6) with the midpoints of its edges.
            corners: rest positions of the three corners [mm], shape (f, 3, 3).
            spacing: largest distance between neighbouring points [mm], about.
        """
        edges = np.roll(corners, -1, axis=1) - corners
        whole = 0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
        longest = np.linalg.norm(edges, axis=2).max(axis=1)
        cuts = np.clip(np.ceil(longest / (2.0 * spacing) - 1e-9), 1, _MOST_CUTS).astype(np.int64)
        face, places = [np.empty(0, dtype=np.int64)], [np.empty((0, 3))]
        for n in np.unique(cuts):
            some, lattice = np.flatnonzero(cuts == n), _lattice(int(n))
            face.append(np.repeat(some, len(lattice)))
            places.append(np.tile(lattice, (len(some), 1)))
        owner = np.concatenate(face)
        order = np.argsort(owner, kind="stable")
        owner, at = owner[order], np.concatenate(places)[order]
        if faces.shape[1] == 6:
            middle = 4.0 * at[:, FACE_EDGES[:, 0]] * at[:, FACE_EDGES[:, 1]]
            at = np.concatenate([at * (2.0 * at - 1.0), middle], axis=1)
        return FacePoints(faces, owner, at, (whole / (3 * cuts**2))[owner])


def _lattice(n: int) -> FloatArray:
    """Barycentric coordinates of the three points of each of the n² equal triangles of a triangle, shape (3n², 3)."""
    i, j = (index.ravel() for index in np.meshgrid(np.arange(n), np.arange(n), indexing="ij"))
    base = np.stack([i, j], axis=1)
    upright = base[i + j < n][:, None] + np.array([[0, 0], [1, 0], [0, 1]])
    turned = base[i + j < n - 1][:, None] + np.array([[1, 1], [0, 1], [1, 0]])
    corners = np.concatenate([upright, turned]) / n
    inner = np.einsum("qa,tak->tqk", TRIANGLE_3.points, corners).reshape(-1, 2)
    return np.column_stack([inner, 1.0 - inner.sum(axis=1)])
