"""ElasticPrior: the linear response of the mixed-material body, known exactly from one factorization.

Linearised at rest, equilibrium under forces f on contact nodes L reads K q = Sᵀ f in the reduced unknowns q (soft
displacements, and one twist a rigid part), so that q = C f with the compliance C = K⁻¹ Sᵀ. Imposing the displacement
d of the contact nodes means S C f = d:

    f = (S C)_LL⁻¹ d,     q = C_L f.

C is computed once for every node that a probe may touch; a prediction then solves one small dense system. Rigid parts
move by the finite rotation of their twist, so that their edges keep their length.
"""

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mixpinn.base.arrays import AnyArray, Float32Array, FloatArray, IntArray
from mixpinn.base.errors import InputError
from mixpinn.base.files import atomic_path, write_json
from mixpinn.base.manifest import Artefact
from mixpinn.base.validated import ArraySpec, load_arrays, load_record
from mixpinn.physics.cholesky import cholesky_in_place, cholesky_solve
from mixpinn.physics.restraints import FREE, Restraints
from mixpinn.records import TissueMesh
from mixpinn.records.answer import discretisation_of
from mixpinn.reduced.compliance import cluster_files
from mixpinn.reduced.compliance.clusters import ClusteredCompliance
from mixpinn.reduced.compliance.forms import Compliance, DenseCompliance, FactoredCompliance
from mixpinn.reduced.compliance.row_products import block_of
from mixpinn.reduced.coordinates import ReducedCoordinates

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mixpinn.fem import LinearSolver, Material

_ABOUT, _COMPLIANCE = "prior.json", "compliance.npy"
_LEFT, _RIGHT, _OWN = "left.npy", "right.npy", "own.npy"
_EARLIER = ("numbers.npy", "scale.npy", "exact.npy")
_CLUSTERED = tuple(f"{name}.npy" for name in cluster_files.SPECS)
FILES = tuple(dict.fromkeys((_ABOUT, _COMPLIANCE, _LEFT, _RIGHT, _OWN, *_EARLIER, *_CLUSTERED)))
"""All that a prior may have; compliance, whole or in clusters (`_EARLIER`: as earlier versions wrote it), or its
factors."""
DENSE_BYTES = 1 << 30
"""Beyond this size [byte] a compliance is made cluster by cluster: it might not fit beside all else in memory."""
PRIOR = Artefact("elastic prior", 1, "make the prior again (one in the cache is made anew by itself)")


class ContactSystem:
    """Some contact nodes of a prior, held together: l nodes.

    Rows and unknowns cost nothing; the block of the compliance is factorized when `solve` first needs it.

    Attributes:
        rows: their rows in the compliance, shape (3 l,).
        unknowns: the reduced unknowns that are their displacements, shape (3 l,).
    """

    def __init__(self, rows: IntArray, unknowns: IntArray, own: FloatArray) -> None:
        """Name the nodes.

        Args:
            rows, unknowns: see above.
            own: compliance of all contact nodes of the prior among themselves [mm/N], shape (3 c, 3 c).
        """
        self.rows, self.unknowns, self._own = rows, unknowns, own

    @cached_property
    def _factor(self) -> FloatArray:
        lower: FloatArray = block_of(self._own, self.rows)
        if not cholesky_in_place(lower):
            raise np.linalg.LinAlgError("the compliance of the contact nodes is not positive definite")
        return lower

    def solve(self, displacement: AnyArray) -> FloatArray:
        """Forces [N], shape (3 l,), that displace the nodes by `displacement` [mm], shape (3 l,)."""
        force = np.array(displacement, dtype=np.float64)
        cholesky_solve(self._factor, force)
        return force


def probed_nodes(mesh: TissueMesh, *, margin: float = 45.0) -> IntArray:
    """Free skin nodes that a probe on the back may touch: those of faces that face backwards, over the bones.

    A probe touches what lies within half its length of its tip, and a little beside it where it is tilted: of a linear
    probe 29 mm and up to 7. Contact needs whole faces, so all nodes of a face that begins within the margin belong.

    Args:
        mesh: the mesh.
        margin: how far beyond the pressed bones' extent along x and z faces still begin [mm].
    """
    corners = mesh.points[mesh.skin_faces]
    a, b, c = np.moveaxis(corners, 1, 0)
    bones = mesh.pressed_points
    low, high = bones.min(axis=0) - margin, bones.max(axis=0) + margin
    over = ((corners.max(axis=1) >= low) & (corners.min(axis=1) <= high))[:, [0, 2]].all(axis=1)
    above = corners[:, :, 1].max(axis=1) > mesh.target_points[:, 1].mean()
    nodes = np.unique(mesh.skin_node_faces[over & above & (np.cross(b - a, c - a)[:, 1] > 0.0)])
    chosen: IntArray = nodes[~mesh.node_fixed[nodes]]
    return chosen


_FACTORS = {
    "left": ArraySpec("number", ("rows", "rank")), "right": ArraySpec("number", ("rank", "unknowns")),
    "own": ArraySpec("number", ("rows", "rows")),
}
_ONE_CLUSTER = {
    "numbers": ArraySpec("index", ("rows", "inside")), "scale": ArraySpec("number", ("rows",)),
    "exact": ArraySpec("number", ("rows", "others")),
}


@dataclass(frozen=True)
class _About:
    """What ``prior.json`` holds."""

    mesh_hash: str
    nodes: tuple[int, ...]
    name: str
    tolerance: float = 0.0
    missed: float = 0.0
    factored: bool = False
    packed: bool = False
    clustered: bool = False
    restraints: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class ElasticPrior:
    """Contact displacement in, displacement of every node and contact forces out; no training.

    Attributes:
        mesh: the mesh.
        nodes: contact nodes that may be imposed, ascending, shape (c,).
        compliance: response of every reduced unknown to a unit force at each of them [mm/N], shape (3 c, n_dofs): free
            soft nodes in ascending order, then translation and rotation vector of each part.
        name: for tables.
        missed: relative error (root mean square, away from the contact nodes) of its responses to contacts that its
            modes were not drawn from; 0 where the compliance is exact.
        restraints: joints and foundations of the body.
    """

    mesh: TissueMesh
    nodes: IntArray
    compliance: Compliance
    name: str = "Elastic prior"
    missed: float = 0.0
    restraints: Restraints = FREE

    def __post_init__(self) -> None:
        coordinates = ReducedCoordinates(self.mesh)
        order = np.searchsorted(coordinates.free, self.nodes)
        own = self.compliance.own((3 * order[:, None] + np.arange(3)).ravel()).astype(np.float64)
        object.__setattr__(self, "_coordinates", coordinates)
        object.__setattr__(self, "_first_unknown", 3 * order)
        object.__setattr__(self, "_own", 0.5 * (own + own.T))

    @property
    def coordinates(self) -> ReducedCoordinates:
        """The reduced unknowns."""
        found: ReducedCoordinates = self._coordinates  # type: ignore[attr-defined]
        return found

    @property
    def own_compliance(self) -> FloatArray:
        """Displacement of the contact nodes under unit forces on them [mm/N], symmetric, shape (3 c, 3 c)."""
        found: FloatArray = self._own  # type: ignore[attr-defined]
        return found

    def hold(self, nodes: AnyArray) -> ContactSystem:
        """The system of contact nodes (l,), which several solves share.

        Raises:
            InputError: a node that the prior was not prepared for.
        """
        rows = self._rows(nodes)
        first: IntArray = self._first_unknown[rows[::3] // 3]  # type: ignore[attr-defined]
        return ContactSystem(rows, (first[:, None] + np.arange(3)).ravel(), self.own_compliance)

    @staticmethod
    def build(
        mesh: TissueMesh, materials: "Sequence[Material]", *, nodes: IntArray | None = None,
        linear: "LinearSolver | None" = None, chunk: int = 96, restraints: Restraints = FREE,
    ) -> "ElasticPrior":
        """The prior of a body; see `mixpinn.reduced.build_prior`."""
        # Imported here: building brings the solver, answering does without it.
        from mixpinn.reduced.build_prior import build_prior

        return build_prior(mesh, materials, nodes=nodes, linear=linear, chunk=chunk, restraints=restraints)

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
        contact = self.hold(nodes)
        force = contact.solve(np.asarray(displacement).ravel())
        return self.respond_to_forces(contact, force).astype(np.float64), force.reshape(-1, 3)

    def respond_to_forces(self, contact: ContactSystem, force: AnyArray) -> Float32Array:
        """The reduced unknowns [mm, rad], shape (D,), under forces [N], shape (3 l,), on contact nodes."""
        return self.compliance.respond(contact.rows, force)

    def _rows(self, nodes: AnyArray) -> IntArray:
        """Rows of the compliance that belong to contact nodes, shape (3 l,)."""
        index = np.minimum(np.searchsorted(self.nodes, nodes), len(self.nodes) - 1)
        if (self.nodes[index] != nodes).any():
            unknown = int(np.asarray(nodes)[self.nodes[index] != nodes][0])
            raise InputError(
                "contact nodes", expected="nodes of the probed skin", got=f"node {unknown}",
                fix="build the prior with a larger set of nodes",
            )
        rows: IntArray = (3 * index[:, None] + np.arange(3)).ravel()
        return rows

    def expand(self, unknowns: AnyArray) -> Float32Array:
        """Displacement of every mesh node [mm], float32, shape (n, 3), for unknowns (D,), with finite rotations."""
        return self.coordinates.expand(unknowns)

    def predict(self, nodes: AnyArray, displacements: AnyArray) -> Float32Array:
        """Displacement of every node [mm], shape (n, 3), from that of contact nodes; operands as in `respond`."""
        unknowns, _ = self.respond(nodes, displacements)
        return self.expand(unknowns)

    def save(self, folder: Path | str, *, tolerance: float = 0.0, packed: bool = False) -> None:
        """Write the compliance (.npy, mapped into memory when read) and what it belongs to.

        Args:
            folder: where to.
            tolerance: with a positive one, a C that is not in factors is written as a product of two smaller matrices
                that differs from it by at most this share, in the Frobenius norm; the contact nodes' own block stays
                exact. Such a prior is multiplied out when it is read, unless that would take more than `DENSE_BYTES`.
            packed: without tolerance, write a dense C in clusters; see `mixpinn.reduced.compliance.clusters`.
        """
        folder, record = Path(folder), self.restraints.record()
        Restraints.of_record(record, "joints of a prior that is kept")  # a law of the user's own cannot be read back
        arrays = self._arrays(tolerance, packed)
        for name, array in arrays.items():
            with atomic_path(folder / name) as temporary:
                np.save(temporary, array, allow_pickle=False)
        write_json(folder / _ABOUT, {
            "mesh_hash": self.mesh.hash(), "nodes": self.nodes, "name": self.name, "tolerance": max(tolerance, 0.0),
            "missed": self.missed, "factored": _RIGHT in arrays, "clustered": "close.npy" in arrays,
            "restraints": record,
        })
        PRIOR.seal(folder, [_ABOUT, *arrays])

    def _arrays(self, tolerance: float, packed: bool) -> dict[str, AnyArray]:
        """What `save` writes, by the names of files."""
        kept = self.compliance
        if isinstance(kept, FactoredCompliance):
            return {_LEFT: kept.left, _RIGHT: kept.right, _OWN: kept.block}
        if isinstance(kept, ClusteredCompliance):
            if tolerance <= 0.0:
                return _named(cluster_files.arrays_of(kept))
            kept = DenseCompliance(kept.dense())
        assert isinstance(kept, DenseCompliance)
        if packed and tolerance <= 0.0:
            return _named(cluster_files.arrays_of(self._clustered))
        factors: dict[str, AnyArray] = {_COMPLIANCE: kept.matrix}
        if tolerance > 0.0:
            factors = self._factors(kept.matrix, tolerance)
        return factors

    @cached_property
    def _clustered(self) -> ClusteredCompliance:
        """A dense compliance in clusters, found once: onboarding writes one prior after every round."""
        whole = self.compliance
        assert isinstance(whole, DenseCompliance)
        own, free = self._own_unknowns(), self.coordinates.free
        inside = np.setdiff1d(free, self.nodes)
        return ClusteredCompliance.of(
            whole.matrix, exact_unknowns(own, self.coordinates), self.mesh.node_points[self.nodes],
            self.mesh.node_points[inside],
        )

    def _factors(self, matrix: Float32Array, tolerance: float) -> dict[str, AnyArray]:
        """C ≈ V_r (V_rᵀ C) with the r leading left singular vectors V_r, and the exact own block."""
        dense = np.asarray(matrix, dtype=np.float64)
        squared, vectors = np.linalg.eigh(dense @ dense.T)
        discarded = np.sqrt(np.maximum(np.cumsum(squared), 0.0) / squared.sum())
        left = vectors[:, int(np.searchsorted(discarded, tolerance, side="right")):]
        return {
            _LEFT: left.astype(np.float32), _RIGHT: (left.T @ dense).astype(np.float32),
            _OWN: dense[:, self._own_unknowns()].astype(np.float32),
        }

    def _own_unknowns(self) -> IntArray:
        """The reduced unknowns that are displacements of the contact nodes, shape (3 c,)."""
        first: IntArray = self._first_unknown  # type: ignore[attr-defined]
        return (first[:, None] + np.arange(3)).ravel()

    @staticmethod
    def load(folder: Path | str, mesh: TissueMesh) -> "ElasticPrior":
        """Read what `save` wrote; the compliance stays on disk until it is used.

        Raises:
            InputError: absent, damaged, or of another mesh.
        """
        folder = Path(folder)
        PRIOR.check(folder, _ABOUT)
        about = load_record(_About, folder / _ABOUT, remake=PRIOR.remake)
        if about.mesh_hash != mesh.hash():
            raise InputError(
                str(folder), expected=f"a prior of {discretisation_of(mesh)}",
                got=f"one of another mesh, {about.mesh_hash}",
                fix="load it with the mesh that it was built for, or build the prior for this mesh",
            )
        nodes, free = np.array(about.nodes, dtype=np.int64), ReducedCoordinates(mesh).free
        extents = {"c": len(nodes), "rows": 3 * len(nodes), "unknowns": ReducedCoordinates(mesh).size}
        checked = ArraySpec("index", ("c",), low=0, high=mesh.n_nodes - 1)
        checked.check(nodes, f"{folder / _ABOUT}: nodes", extents=extents, remake=PRIOR.remake)
        if not np.isin(nodes, free).all():
            raise InputError(
                f"{folder / _ABOUT}: nodes", expected="free soft nodes", got="fixed or rigid ones", fix=PRIOR.remake,
            )
        compliance: Compliance
        if about.factored or about.tolerance > 0.0:
            PRIOR.check(folder, _LEFT, _RIGHT, _OWN)
            arrays = load_arrays(folder, _FACTORS, remake=PRIOR.remake, extents=extents)
            own = (3 * np.searchsorted(free, nodes)[:, None] + np.arange(3)).ravel()
            right = arrays["right"]
            right[:, own] = 0.0  # the own block stands in their place
            factored = FactoredCompliance(arrays["left"], right, arrays["own"], own)
            exact = about.missed == 0.0 and 4 * extents["rows"] * extents["unknowns"] <= DENSE_BYTES
            compliance = factored.dense() if exact else factored
        elif about.packed or about.clustered:
            PRIOR.check(folder, *(_CLUSTERED if about.clustered else _EARLIER))
            own = (3 * np.searchsorted(free, nodes)[:, None] + np.arange(3)).ravel()
            unknowns = exact_unknowns(own, ReducedCoordinates(mesh))
            extents |= {"others": len(unknowns), "inside": extents["unknowns"] - len(unknowns), "contacts": len(nodes)}
            extents["nodes_inside"] = extents["inside"] // 3
            arrays = load_arrays(
                folder, cluster_files.SPECS if about.clustered else _ONE_CLUSTER, remake=PRIOR.remake,
                extents=extents, mapped=cluster_files.MAPPED if about.clustered else ("numbers",),
            )
            compliance = (
                cluster_files.compliance_of(arrays, unknowns, where=str(folder), remake=PRIOR.remake)
                if about.clustered
                else cluster_files.of_one_cluster(arrays["numbers"], arrays["scale"], arrays["exact"], unknowns)
            )
        else:
            PRIOR.check(folder, _COMPLIANCE)
            whole = {"compliance": ArraySpec("number", ("rows", "unknowns"))}
            compliance = DenseCompliance(load_arrays(
                folder, whole, remake=PRIOR.remake, extents=extents, mapped=("compliance",),
            )["compliance"])
        restraints = Restraints.of_record(about.restraints, str(folder / _ABOUT))
        return ElasticPrior(mesh, nodes, compliance, about.name, about.missed, restraints)


def exact_unknowns(own: IntArray, coordinates: ReducedCoordinates) -> IntArray:
    """What a packed compliance keeps as it is: the contact nodes' own unknowns (R,), then all twists."""
    return np.concatenate([own, np.arange(coordinates.n_soft, coordinates.size)])


def _named(arrays: dict[str, AnyArray]) -> dict[str, AnyArray]:
    return {f"{name}.npy": array for name, array in arrays.items()}
