"""ElasticPrior: the linear response of the mixed-material body, known exactly from one factorization.

Linearised at rest, equilibrium under forces f on contact nodes L reads K q = Sᵀ f in the reduced unknowns q (soft
displacements, and one twist a rigid part), so that q = C f with the compliance C = K⁻¹ Sᵀ. Imposing the displacement
d of the contact nodes means S C f = d:

    f = (S C)_LL⁻¹ d,     q = C_L f.

C is computed once for every node that a probe may touch; a prediction then solves one small dense system. Rigid parts
move by the finite rotation of their twist, so that their edges keep their length.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg
from scipy.spatial.transform import Rotation

from mixpinn.base.arrays import AnyArray, Float32Array, FloatArray, IntArray
from mixpinn.base.errors import InputError
from mixpinn.base.files import atomic_path, read_json, write_json
from mixpinn.records import TissueMesh

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mixpinn.fem import LinearSolver, Material

_ABOUT, _COMPLIANCE = "prior.json", "compliance.npy"


def probed_nodes(mesh: TissueMesh, *, margin: float = 60.0) -> IntArray:
    """Free skin nodes that a probe on the back may touch: those that face backwards, over the rigid parts.

    Args:
        mesh: the mesh.
        margin: how far beyond the rigid parts' extent along x and z nodes still count [mm].
    """
    faces = mesh.skin_faces
    a, b, c = (mesh.points[faces[:, corner]] for corner in range(3))
    backwards = faces[np.cross(b - a, c - a)[:, 1] > 0.0]
    nodes = np.unique(backwards)
    nodes = nodes[~mesh.fixed[nodes]]
    rigid = mesh.points[mesh.part > 0] if mesh.n_parts else mesh.points
    low, high = rigid.min(axis=0) - margin, rigid.max(axis=0) + margin
    points = mesh.points[nodes]
    over = ((points >= low) & (points <= high))[:, [0, 2]].all(axis=1)
    chosen: IntArray = nodes[over & (points[:, 1] > rigid[:, 1].mean())]
    return chosen


@dataclass(frozen=True, eq=False)
class ElasticPrior:
    """Contact displacement in, displacement of every node and contact forces out; no training.

    Attributes:
        mesh: the mesh.
        nodes: contact nodes that may be imposed, ascending, shape (c,).
        compliance: response of every reduced unknown to a unit force at each of them [mm/N], float32, shape
            (3 c, n_dofs): free soft nodes in ascending order, then translation and rotation vector of each part.
        name: for tables.
    """

    mesh: TissueMesh
    nodes: IntArray
    compliance: Float32Array
    name: str = "Elastic prior"

    def __post_init__(self) -> None:
        free = np.flatnonzero((self.mesh.part == 0) & ~self.mesh.fixed)
        order = np.searchsorted(free, self.nodes)
        own = self.compliance[:, (3 * order[:, None] + np.arange(3)).ravel()].astype(np.float64)
        object.__setattr__(self, "_free", free)
        object.__setattr__(self, "_own", 0.5 * (own + own.T))

    @staticmethod
    def build(
        mesh: TissueMesh, materials: "Sequence[Material]", *, nodes: IntArray | None = None,
        linear: "LinearSolver | None" = None, chunk: int = 96,
    ) -> "ElasticPrior":
        """Factorize the rest-state stiffness and solve for every contact node.

        Args:
            mesh: the mesh.
            materials: one for each tissue.
            nodes: contact nodes to prepare, shape (c,); by default `probed_nodes`.
            linear: sparse direct solver.
            chunk: right-hand sides at a time.

        Raises:
            InputError: a node is fixed or rigid, or there is none.
        """
        from mixpinn.base.progress import track
        from mixpinn.fem import ElasticSystem, default_solver

        nodes = probed_nodes(mesh) if nodes is None else np.unique(nodes)
        if not len(nodes) or (mesh.part[nodes] > 0).any() or mesh.fixed[nodes].any():
            raise InputError(
                "contact nodes", expected="free soft nodes of the mesh", got="none, or fixed or rigid ones",
                fix="choose nodes of the probed skin",
            )
        system = ElasticSystem(mesh, materials)
        linear = linear or default_solver()
        linear.factorize(system.tangent(system.rest_state(), project=True))
        unknowns = system.node_dofs(nodes).ravel()
        compliance = np.empty((len(unknowns), system.n_dofs), dtype=np.float32)
        for start in track(range(0, len(unknowns), chunk), "elastic prior"):
            columns = unknowns[start : start + chunk]
            forces = np.zeros((system.n_dofs, len(columns)))
            forces[columns, np.arange(len(columns))] = 1.0
            compliance[start : start + len(columns)] = linear.solve(forces).T
        return ElasticPrior(mesh, nodes, compliance)

    def respond(self, nodes: AnyArray, displacement: AnyArray) -> tuple[FloatArray, FloatArray]:
        """The reduced unknowns and the contact forces that go with imposed displacements.

        Args:
            nodes: contact nodes, distinct, shape (l,).
            displacement: of each [mm], shape (l, 3).

        Returns:
            Unknowns, shape (n_dofs,) [mm, rad], and forces on the nodes, shape (l, 3) [N].

        Raises:
            InputError: a node that the prior was not prepared for.
        """
        index = np.minimum(np.searchsorted(self.nodes, nodes), len(self.nodes) - 1)
        if (self.nodes[index] != nodes).any():
            unknown = int(np.asarray(nodes)[self.nodes[index] != nodes][0])
            raise InputError(
                "contact nodes", expected="nodes of the probed skin", got=f"node {unknown}",
                fix="build the prior with a larger set of nodes",
            )
        rows = (3 * index[:, None] + np.arange(3)).ravel()
        own: FloatArray = self._own[np.ix_(rows, rows)]  # type: ignore[attr-defined]
        force = scipy.linalg.solve(own, np.asarray(displacement, dtype=np.float64).ravel(), assume_a="pos")
        unknowns = force.astype(np.float32) @ self.compliance[rows]
        return unknowns.astype(np.float64), force.reshape(-1, 3)

    def expand(self, unknowns: FloatArray) -> FloatArray:
        """Displacement of every mesh node [mm], shape (n, 3), for reduced unknowns; twists as finite rotations."""
        free: IntArray = self._free  # type: ignore[attr-defined]
        field = np.zeros((self.mesh.n_points, 3))
        field[free] = unknowns[: 3 * len(free)].reshape(-1, 3)
        for k, twist in enumerate(unknowns[3 * len(free) :].reshape(-1, 6), start=1):
            part = self.mesh.part_nodes(k)
            arm = self.mesh.points[part] - self.mesh.points[part].mean(axis=0)
            field[part] = twist[:3] + arm @ (Rotation.from_rotvec(twist[3:]).as_matrix() - np.eye(3)).T
        return field

    def predict(self, contact_displacement: AnyArray) -> Float32Array:
        """Displacement of every node [mm], shape (n, 3), from that of the contact nodes, zero elsewhere (n, 3)."""
        nodes = np.flatnonzero(np.any(contact_displacement != 0.0, axis=1))
        if not len(nodes):
            return np.zeros((self.mesh.n_points, 3), dtype=np.float32)
        unknowns, _ = self.respond(nodes, contact_displacement[nodes])
        return self.expand(unknowns).astype(np.float32)

    def save(self, folder: Path | str) -> None:
        """Write the compliance (.npy, mapped into memory when read) and what it belongs to."""
        folder = Path(folder)
        with atomic_path(folder / _COMPLIANCE) as temporary:
            np.save(temporary, self.compliance, allow_pickle=False)
        write_json(folder / _ABOUT, {"mesh_hash": self.mesh.hash(), "nodes": self.nodes, "name": self.name})

    @staticmethod
    def load(folder: Path | str, mesh: TissueMesh) -> "ElasticPrior":
        """Read what `save` wrote; the compliance stays on disk until it is used.

        Raises:
            InputError: absent, damaged, or of another mesh.
        """
        folder = Path(folder)
        about = read_json(folder / _ABOUT)
        if about["mesh_hash"] != mesh.hash():
            raise InputError(
                str(folder), expected=f"a prior of mesh {mesh.hash()}", got=f"one of mesh {about['mesh_hash']}",
                fix="build the prior for this mesh",
            )
        try:
            compliance = np.load(folder / _COMPLIANCE, mmap_mode="r", allow_pickle=False)
        except (OSError, ValueError) as error:
            raise InputError(
                str(folder / _COMPLIANCE), expected="a compliance matrix", got=str(error), fix="build the prior again",
            ) from error
        return ElasticPrior(mesh, np.array(about["nodes"], dtype=np.int64), compliance, about["name"])
