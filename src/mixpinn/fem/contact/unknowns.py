"""Which unknowns of the elastic body a patch of skin hangs on, and how."""

from dataclasses import dataclass

import numpy as np

from mixpinn.base.arrays import BoolArray, FloatArray, IntArray
from mixpinn.fem.contact.surfaces import SkinPatch, SkinSurface
from mixpinn.fem.elements.system import ElasticSystem, State


@dataclass(frozen=True, eq=False)
class Link:
    """How coordinates of a patch's vertices hang on the kept unknowns at one configuration; v vertices, m unknowns.

    Attributes:
        jacobian: derivative of the coordinates, shape (3 v, m); None where each coordinate is an unknown or held.
        columns: the unknown of each coordinate, −1 where it is held, shape (3 v,); used where there is no jacobian.
        count: m.
    """

    jacobian: FloatArray | None
    columns: IntArray
    count: int

    def move(self, y: FloatArray) -> FloatArray:
        """Displacement of the vertices [mm], shape (v, 3), for increments y of the unknowns, shape (m,)."""
        if self.jacobian is not None:
            return np.einsum("ij,j->i", self.jacobian, y).reshape(-1, 3)
        return np.append(y, 0.0)[self.columns].reshape(-1, 3)

    def reduce(self, gradient: FloatArray) -> FloatArray:
        """Gradient by vertices (v, 3) as gradient by unknowns (m,)."""
        if self.jacobian is not None:
            return np.einsum("i,ij->j", gradient.ravel(), self.jacobian)
        reduced: FloatArray = np.zeros(self.count + 1)
        reduced[self.columns] = gradient.ravel()
        return reduced[:-1]

    def reduce_stiffness(self, stiffness: FloatArray, touched: BoolArray) -> tuple[FloatArray, IntArray]:
        """Stiffness (3 a, 3 a) of the a `touched` vertices (v,) by the unknowns that move them, and these unknowns."""
        rows = np.flatnonzero(np.repeat(touched, 3))
        if self.jacobian is not None:
            some = self.jacobian[rows]
            columns = np.flatnonzero(some.any(axis=0))
            some = some[:, columns]
            return some.T @ stiffness @ some, columns
        columns = self.columns[rows]
        moving = columns >= 0
        if moving.all():
            return stiffness, columns
        return stiffness[np.ix_(moving, moving)], columns[moving]


class ContactUnknowns:
    """Link between a patch's vertices and the unknowns of the body.

    Attributes:
        kept: unknowns that move a vertex of the patch, ascending, shape (m,).
    """

    def __init__(
        self, system: ElasticSystem, skin: SkinSurface, patch: SkinPatch, *, held: BoolArray | None = None,
    ) -> None:
        """Look up what moves each vertex: free nodes, or rigid parts where a vertex lies in a cell beside one.

        Args:
            system: the body.
            skin: its skin.
            patch: the part of the skin.
            held: unknowns that do not change, shape (n_dofs,).
        """
        self._system, self._skin, self._patch = system, skin, patch
        self._nodes, self._weights = skin.nodes[patch.vertices], skin.weights[patch.vertices]
        n_parts = system.mesh.n_parts
        part = system.mesh.node_part[self._nodes].astype(np.int64)
        soft = system.node_dofs(self._nodes.ravel()).reshape(*self._nodes.shape, 3)
        used = self._weights != 0.0
        self._first_twist = system.n_dofs - 6 * n_parts
        self._rigid: list[tuple[int, IntArray]] = [
            (k, np.argwhere((part == k + 1) & used)) for k in range(n_parts) if ((part == k + 1) & used).any()
        ]
        twists = [self._first_twist + 6 * k + np.arange(6) for k, _ in self._rigid]
        moving = np.unique(np.concatenate([soft[used].ravel(), *twists, np.empty(0, dtype=np.int64)]))
        moving = moving[moving >= 0]
        plain = self._nodes.shape[1] == 1 and not self._rigid
        self._soft_jacobian = np.zeros((0, 0) if plain else (3 * len(patch.vertices), len(moving)))
        vertex, which = np.nonzero(used)
        for axis in () if plain else range(3):
            unknown = soft[vertex, which, axis]
            moved = unknown >= 0
            place = (3 * vertex[moved] + axis, np.searchsorted(moving, unknown[moved]))
            np.add.at(self._soft_jacobian, place, self._weights[vertex, which][moved])
        self._moving = moving
        still = system.locked if held is None else held | system.locked
        self._free = ~still[moving]
        self.kept: IntArray = moving[self._free]
        self._plain: Link | None = None
        if self._nodes.shape[1] == 1 and not self._rigid:
            index = np.full(system.n_dofs + 1, -1, dtype=np.int64)
            index[self.kept] = np.arange(len(self.kept))
            self._plain = Link(None, index[soft.ravel()], len(self.kept))

    def link(self, state: State) -> Link:
        """How the vertices hang on the kept unknowns at a configuration."""
        return self._plain or Link(self.jacobian(state), np.empty(0, dtype=np.int64), len(self.kept))

    def positions(self, state: State) -> FloatArray:
        """Positions of the patch's vertices [mm], shape (v, 3)."""
        if self._nodes.shape[1] == 1:
            return state.points[self._nodes[:, 0]]
        return np.einsum("vw,vwk->vk", self._weights, state.points[self._nodes])

    def jacobian(self, state: State) -> FloatArray:
        """Derivative of the vertices' coordinates by the kept unknowns, shape (3 v, m)."""
        if self._plain is not None:
            return np.eye(len(self.kept) + 1)[self._plain.columns][:, :-1]
        if not self._rigid:
            return self._soft_jacobian[:, self._free]
        jacobian = self._soft_jacobian.copy()
        for k, places in self._rigid:
            column = int(np.searchsorted(self._moving, self._first_twist + 6 * k))
            centre = state.points[self._system.mesh.part_nodes(k + 1)].mean(axis=0)
            for v, w in places:
                weight = self._weights[v, w]
                x, y, z = weight * (state.points[self._nodes[v, w]] - centre)
                jacobian[3 * v : 3 * v + 3, column : column + 3] += weight * np.eye(3)
                # δx = δw × d
                jacobian[3 * v : 3 * v + 3, column + 3 : column + 6] += [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
        return jacobian[:, self._free]

    def on_nodes(self, gradient: FloatArray) -> FloatArray:
        """Gradient by vertices (v, 3) as gradient by mesh nodes [N], shape (n, 3)."""
        nodal = np.zeros((self._system.mesh.n_nodes, 3))
        for column in range(self._nodes.shape[1]):
            np.add.at(nodal, self._nodes[:, column], self._weights[:, column, None] * gradient)
        return nodal
