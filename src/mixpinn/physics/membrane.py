"""The skin as a membrane: a sheet without thickness on the faces of the mesh, which stretches and bends but no shell.

With F the deformation gradient of a face in its own plane (3 × 2), C = Fᵀ F and J = √det C its change of area, the
energy of an incompressible Neo-Hookean sheet in plane stress and of a surface tension is, per area at rest,

    W = ½ μh (tr C + J⁻² − 3) + γ (J − 1).

The first is stress-free at rest and has Young's modulus times thickness E h = 3 μh. The tension pulls at rest already;
tissue that lies still carries it, so that its forces at rest count as given ones:

    E = ∫ W dA − Σ_a u_a · γ ∂A/∂x_a (rest).

What is left of it is the stiffness of a stretched skin against bending. Given forces keep their direction: the second
term is not free of rigid rotations of the whole body, which its supports prevent.
"""

from dataclasses import dataclass

import numpy as np

from mixpinn.base.arrays import AnyArray, FloatArray, IntArray
from mixpinn.base.sensible import not_negative, require_settings
from mixpinn.physics.foundation import cap_nodes
from mixpinn.physics.membrane_kernel import add_membrane_forces, membrane_energy, membrane_stiffness
from mixpinn.records.tissue_mesh import TissueMesh

_CORNERS = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
_RATES = np.array([[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]])
"""Derivatives of the barycentric coordinates by the second and third of them."""


@dataclass(frozen=True)
class Membrane:
    """A membrane on the skin, the caps of the crop left out.

    Attributes:
        shear: μh, shear modulus times thickness, a third of Young's modulus times thickness [N/mm].
        tension: γ, tension at rest [N/mm].

    Raises:
        InputError: out of range.
    """

    shear: float = 0.0
    tension: float = 0.0

    def __post_init__(self) -> None:
        require_settings(self, "membrane", not_negative(self, "shear", "tension"))


class MembraneSystem:
    """A membrane as a function of the displacement of a mesh's nodes.

    Args:
        membrane: the membrane; None for none.
        mesh: the mesh.
        faces: nodes of its faces, shape (f, 3) or (f, 6); by default those of the skin that are no cap.
    """

    def __init__(self, membrane: Membrane | None, mesh: TissueMesh, *, faces: IntArray | None = None) -> None:
        self.membrane = membrane or Membrane()
        if membrane is None:
            faces = np.empty((0, 3 if mesh.order == 1 else 6), dtype=np.int64)
        elif faces is None:
            faces = mesh.skin_node_faces[~cap_nodes(mesh)[mesh.skin_faces].all(axis=1)]
        self.faces: IntArray = np.ascontiguousarray(faces, dtype=np.int64)
        self._rest: FloatArray = np.ascontiguousarray(mesh.node_points, dtype=np.float64)
        self._gradients, self._weights = face_shapes(self._rest, self.faces)
        self._nodes = np.unique(self.faces)
        pull = np.zeros_like(self._rest)
        if len(self.faces):
            add_membrane_forces(self.faces, self._rest, *self._shapes, 0.0, self.membrane.tension, pull)
        self._pull: FloatArray = pull[self._nodes]

    def __len__(self) -> int:
        return len(self.faces)

    @property
    def _shapes(self) -> tuple[FloatArray, FloatArray]:
        return self._gradients, self._weights

    @property
    def _law(self) -> tuple[float, float]:
        return self.membrane.shear, self.membrane.tension

    def _moved(self, moved: AnyArray) -> FloatArray:
        points = self._rest.copy()
        points[self._nodes] += moved[self._nodes]
        return points

    def energy(self, moved: AnyArray) -> float:
        """E [N mm] for the displacement of all nodes [mm], shape (n, 3)."""
        whole = float(membrane_energy(self.faces, self._moved(moved), *self._shapes, *self._law))
        return whole - float((self._pull * moved[self._nodes]).sum())

    def add_forces(self, moved: AnyArray, nodal: AnyArray) -> None:
        """Add ∂E/∂u [N] to the forces `nodal` of all nodes, shape (n, 3)."""
        add_membrane_forces(self.faces, self._moved(moved), *self._shapes, *self._law, nodal)
        nodal[self._nodes] -= self._pull

    def stiffness(self, moved: AnyArray, *, project: bool = False) -> tuple[IntArray, IntArray, FloatArray]:
        """∂²E/∂u² as nodes i (b,), nodes j (b,) and blocks [N/mm] (b, 3, 3), each unordered pair of a face once.

        Args:
            moved: displacement of all nodes [mm], shape (n, 3).
            project: make the share of μh positive semi-definite (`mixpinn.physics.membrane_kernel`).
        """
        count = self.faces.shape[1]
        blocks = np.empty((len(self.faces), count, count, 3, 3))
        membrane_stiffness(self.faces, self._moved(moved), *self._shapes, *self._law, project, blocks)
        a, b = np.triu_indices(count)
        return self.faces[:, a].ravel(), self.faces[:, b].ravel(), blocks[:, a, b].reshape(-1, 3, 3)


def face_shapes(points: FloatArray, faces: IntArray) -> tuple[FloatArray, FloatArray]:
    """Gradients of shape functions and areas of faces whose sides are straight at rest.

    Args:
        points: [mm], shape (n, 3).
        faces: nodes of triangles, those of six in the order of VTK, shape (f, 3) or (f, 6).

    Returns:
        Gradients in the plane of each face at each quadrature point [1/mm], shape (f, q, k, 2), and the area of each
        [mm²], shape (f, q); q is 1 for three nodes and 3 for six.
    """
    x, y, z = (points[faces[:, k]] for k in range(3))
    first, second = y - x, z - x
    normal = np.cross(first, second)
    area = 0.5 * np.linalg.norm(normal, axis=1)
    along = first / np.linalg.norm(first, axis=1, keepdims=True)
    across = np.cross(normal / (2.0 * area)[:, None], along)
    edges = np.stack([
        np.stack([(first * along).sum(axis=1), (second * along).sum(axis=1)], axis=1),
        np.stack([(first * across).sum(axis=1), (second * across).sum(axis=1)], axis=1),
    ], axis=1)
    linear = _RATES @ np.linalg.inv(edges)  # ∇L of the three corners, shape (f, 3, 2)
    if faces.shape[1] == 3:
        return np.ascontiguousarray(linear[:, None]), area[:, None]
    places = (_CORNERS + 1.0 / 3.0) / 2.0  # the rule of three points, exact for polynomials of second degree
    rows = [
        np.concatenate(
            [(4.0 * at - 1.0)[:, None] * linear] + [
                4.0 * (at[i] * linear[:, [j]] + at[j] * linear[:, [i]]) for i, j in ((0, 1), (1, 2), (2, 0))
            ], axis=1,
        ) for at in places
    ]
    return np.ascontiguousarray(np.stack(rows, axis=1)), np.repeat(area[:, None] / 3.0, 3, axis=1)
