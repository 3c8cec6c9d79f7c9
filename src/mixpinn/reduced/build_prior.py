"""Build the elastic prior of a body: one factorization, and a solve for every contact node. Brings the solver."""

from collections.abc import Sequence

import numpy as np

from mixpinn.base.arrays import Float32Array, IntArray
from mixpinn.base.errors import InputError
from mixpinn.base.progress import track
from mixpinn.fem import ElasticSystem, LinearSolver, Material, default_solver
from mixpinn.physics.restraints import FREE, Restraints
from mixpinn.records import TissueMesh
from mixpinn.reduced.compliance.clusters import ClusteredCompliance
from mixpinn.reduced.compliance.forms import DenseCompliance
from mixpinn.reduced.coordinates import ReducedCoordinates
from mixpinn.reduced.prior import DENSE_BYTES, ElasticPrior, exact_unknowns, probed_nodes

_CLUSTER = 64, 940
"""Contact nodes of a cluster, where there are about so many in all. Of more, clusters have more, by the root: their
number and what is near them grow alike."""


def build_prior(
    mesh: TissueMesh, materials: Sequence[Material], *, nodes: IntArray | None = None,
    linear: LinearSolver | None = None, chunk: int = 96, dense_bytes: int = DENSE_BYTES,
    restraints: Restraints = FREE,
) -> ElasticPrior:
    """Factorize the rest-state stiffness and solve for every contact node.

    Args:
        mesh: the mesh.
        materials: one for each tissue.
        nodes: contact nodes to prepare, shape (c,); by default `probed_nodes`.
        linear: sparse direct solver.
        chunk: right-hand sides at a time.
        dense_bytes: a compliance up to this size is kept as a whole [byte], a larger one in clusters.
        restraints: joints and foundations, whose stiffness at rest belongs to the body's.

    Raises:
        InputError: a node is fixed or rigid, or there is none.
    """
    nodes = probed_nodes(mesh) if nodes is None else np.unique(nodes)
    if not len(nodes) or (mesh.node_part[nodes] > 0).any() or mesh.node_fixed[nodes].any():
        raise InputError(
            "contact nodes", expected="free soft nodes of the mesh", got="none, or fixed or rigid ones",
            fix="choose nodes of the probed skin",
        )
    system = ElasticSystem(
        mesh, materials, joints=restraints.joints, foundations=restraints.foundations, membrane=restraints.membrane,
    )
    linear = linear or default_solver()
    linear.factorize(system.tangent(system.rest_state(), project=True))
    unknowns = system.node_dofs(nodes).ravel()

    def solve(rows: IntArray) -> Float32Array:
        """Answers to unit forces on contact nodes by the numbers of the rows."""
        out = np.empty((len(rows), system.n_dofs), dtype=np.float32)
        for start in range(0, len(rows), chunk):
            columns = unknowns[rows[start : start + chunk]]
            forces = np.zeros((system.n_dofs, len(columns)))
            forces[columns, np.arange(len(columns))] = 1.0
            out[start : start + len(columns)] = linear.solve(forces).T
        return out

    if 4 * len(unknowns) * system.n_dofs <= dense_bytes:
        compliance = np.empty((len(unknowns), system.n_dofs), dtype=np.float32)
        for start in track(range(0, len(unknowns), chunk), "elastic prior"):
            rows = np.arange(start, min(start + chunk, len(unknowns)))
            compliance[rows] = solve(rows)
        return ElasticPrior(mesh, nodes, DenseCompliance(compliance), restraints=restraints)
    coordinates = ReducedCoordinates(mesh)
    clusters = ClusteredCompliance.of_solves(
        solve, exact_unknowns(unknowns, coordinates), mesh.node_points[nodes],
        mesh.node_points[np.setdiff1d(coordinates.free, nodes)],
        most=int(_CLUSTER[0] * max(1.0, len(nodes) / _CLUSTER[1]) ** 0.5),
    )
    return ElasticPrior(mesh, nodes, clusters, restraints=restraints)
