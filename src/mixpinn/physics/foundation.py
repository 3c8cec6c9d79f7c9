"""An elastic foundation under a part of the skin: the pad that a patient lies on, or a plane that a cut face slides on.

Each node carries its share a of the skin's area, projected along the axis n that the foundation pushes along (Winkler:
springs side by side that know nothing of each other). With the displacement u of a node, w = u · n away from the
foundation and v across it, its energy is

    E = a [φ(s − w; k, δ) − φ(s; k, δ) + φ'(s; k, δ) w + ½ k_t |v|²],    δ = s / 2,

φ the penalty of `mixpinn.physics.contact_law`. At rest the body lies s deep in the foundation, which carries its weight
there: no force is left, and the stiffness is k. Skin that rises by s leaves the foundation, which then pulls no more
(w ≥ s: the force stays the weight that nothing carries any longer). A foundation without an end of its travel, s = ∞,
holds both ways: E = a [½ k w² + ½ k_t |v|²]. What lies across the axis is held both ways in either case.
"""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from mixpinn.base.arrays import AnyArray, BoolArray, FloatArray, IntArray
from mixpinn.base.sensible import not_negative, require_settings
from mixpinn.physics.contact_law import penalties
from mixpinn.records.tissue_mesh import TissueMesh


class Face(StrEnum):
    """Which part of the skin lies on a foundation.

    Attributes:
        FRONT: skin that looks to the front, the anterior side, away from both caps: what a prone patient lies on.
        CAPS: the two planes where the crop cuts the body.
    """

    FRONT = "front"
    CAPS = "caps"


CAP_MARGIN = 1.0
"""Skin whose nodes all lie closer than this to an end of the body along z is a cap [mm]."""


@dataclass(frozen=True)
class Foundation:
    """Springs under a part of the skin.

    Attributes:
        face: which part.
        stiffness: k, pressure a millimetre along the axis: y for the front, z for the caps [N/mm³].
        shear: k_t, traction a millimetre across it [N/mm³].
        sink: s, how deep the body lies in it at rest [mm]; None holds both ways.
        reach: of the front, skin no farther than this behind the most anterior point counts [mm].

    Raises:
        InputError: out of range.
    """

    face: Face
    stiffness: float
    shear: float = 0.0
    sink: float | None = None
    reach: float = 30.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "face", Face(self.face))
        require_settings(self, "support", {
            **not_negative(self, "stiffness", "shear", "reach"),
            "sink": (
                self.sink is None or (self.sink > 0.0 and self.face is Face.FRONT),
                "above zero under the front, or none",
            ),
        })


class FoundationSystem:
    """Foundations as a function of the displacement of a mesh's nodes.

    Args:
        foundations: the foundations.
        mesh: the mesh; fixed nodes are left out.
    """

    def __init__(self, foundations: tuple[Foundation, ...], mesh: TissueMesh) -> None:
        self.foundations = tuple(foundations)
        nodes, normal, across, sinks = [], [], [], []
        for foundation in self.foundations:
            axis = 1 if foundation.face is Face.FRONT else 2
            found, areas = _shares(mesh, foundation, axis)
            nodes.append(found)
            stiff = np.zeros((len(found), 3))
            stiff[:, axis] = foundation.stiffness * areas
            side = np.repeat((foundation.shear * areas)[:, None], 3, axis=1)
            side[:, axis] = 0.0
            normal.append(stiff)
            across.append(side)
            sinks.append(np.full(len(found), np.inf if foundation.sink is None else foundation.sink))
        self.nodes: IntArray = np.concatenate([*nodes, np.empty(0, dtype=np.int64)])
        self._normal: FloatArray = np.concatenate([*normal, np.empty((0, 3))])
        self._across: FloatArray = np.concatenate([*across, np.empty((0, 3))])
        sink = np.concatenate([*sinks, np.empty(0)])
        self._both = ~np.isfinite(sink)
        self._sink = np.where(self._both, 1.0, sink)[:, None]
        self._rest = _penalty(self._sink, self._sink)

    def __len__(self) -> int:
        return len(self.nodes)

    def energy(self, moved: AnyArray) -> float:
        """E [N mm] for the displacement of all nodes [mm], shape (n, 3)."""
        u = np.asarray(moved, dtype=np.float64)[self.nodes]
        lifted = _penalty(self._sink - u, self._sink)[0] - self._rest[0] + self._rest[1] * u
        along = np.where(self._both[:, None], 0.5 * u * u, lifted)
        return float((self._normal * along + 0.5 * self._across * u * u).sum())

    def add_forces(self, moved: AnyArray, nodal: AnyArray) -> None:
        """Add ∂E/∂u [N] to the forces `nodal` of all nodes, shape (n, 3)."""
        u = np.asarray(moved, dtype=np.float64)[self.nodes]
        lifted = self._rest[1] - _penalty(self._sink - u, self._sink)[1]
        np.add.at(nodal, self.nodes, self._normal * np.where(self._both[:, None], u, lifted) + self._across * u)

    def add_stiffness(self, moved: AnyArray, diagonals: FloatArray) -> None:
        """Add ∂²E/∂u² [N/mm], which couples no two nodes, to the diagonal blocks of all nodes, shape (n, 3, 3)."""
        u = np.asarray(moved, dtype=np.float64)[self.nodes]
        held = np.where(self._both[:, None], 1.0, _penalty(self._sink - u, self._sink)[2])
        stiffness = self._normal * held + self._across
        for axis in range(3):
            np.add.at(diagonals[:, axis, axis], self.nodes, stiffness[:, axis])

    def lifted(self, moved: AnyArray) -> float:
        """Share of the area on foundations with an end of their travel that has left them."""
        u = np.asarray(moved, dtype=np.float64)[self.nodes]
        weight = np.where(self._both[:, None], 0.0, self._normal)
        return float((weight * (u >= self._sink)).sum() / max(weight.sum(), 1e-300))


def _penalty(violation: FloatArray, sink: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """φ, φ' and φ'' of the contact law at k = 1 and δ = s / 2, in the shape of the violations."""
    v, delta = np.broadcast_arrays(violation, 0.5 * sink)
    energy, force, stiffness = penalties(v.ravel(), 1.0, delta.ravel()).reshape(3, *v.shape)
    return energy, force, stiffness


def cap_nodes(mesh: TissueMesh) -> BoolArray:
    """Nodes at the two ends of the body along z, where the crop cuts it, shape (n_nodes,)."""
    z = mesh.node_points[:, 2]
    caps: BoolArray = (z < z.min() + CAP_MARGIN) | (z > z.max() - CAP_MARGIN)
    return caps


def _shares(mesh: TissueMesh, foundation: Foundation, axis: int) -> tuple[IntArray, FloatArray]:
    """Nodes of the face and the area that each carries, projected along the axis [mm²]."""
    corners = mesh.skin_faces
    a, b, c = (mesh.points[corners[:, k]] for k in range(3))
    normal = 0.5 * np.cross(b - a, c - a)
    caps = cap_nodes(mesh)[corners].all(axis=1)
    if foundation.face is Face.CAPS:
        chosen = caps
    else:
        near = mesh.points[:, 1] <= mesh.points[:, 1].min() + foundation.reach
        chosen = ~caps & (normal[:, 1] < 0.0) & near[corners].all(axis=1)
    faces, areas = mesh.skin_node_faces[chosen], np.abs(normal[chosen, axis])
    # The integral of a linear shape function is a third of the face; of a quadratic one that of a midpoint, none of a
    # corner.
    carried = np.zeros(mesh.n_nodes)
    for column in range(3) if mesh.order == 1 else range(3, 6):
        np.add.at(carried, faces[:, column], areas / 3.0)
    carried[mesh.node_fixed | (mesh.node_part > 0)] = 0.0
    nodes: IntArray = np.flatnonzero(carried)
    return nodes, carried[nodes]
