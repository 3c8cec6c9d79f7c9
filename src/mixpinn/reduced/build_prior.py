"""Build the elastic prior of a body: one factorization, and a solve for every contact node. Brings the solver."""

from collections.abc import Sequence

import numpy as np

from mixpinn.base.arrays import IntArray
from mixpinn.base.errors import InputError
from mixpinn.base.progress import track
from mixpinn.fem import ElasticSystem, LinearSolver, Material, default_solver
from mixpinn.records import TissueMesh
from mixpinn.reduced.prior import ElasticPrior, probed_nodes


def build_prior(
    mesh: TissueMesh, materials: Sequence[Material], *, nodes: IntArray | None = None,
    linear: LinearSolver | None = None, chunk: int = 96,
) -> ElasticPrior:
    """Factorize the rest-state stiffness and solve for every contact node.

    Args:
        mesh: the mesh.
        materials: one for each tissue.
        nodes: contact nodes to prepare, shape (c,); by default `probed_nodes`.
        linear: sparse direct solver.
        chunk: right-hand sides at a time.

    Raises:
        InputError: quadratic cells, or a node that is fixed or rigid, or none.
    """
    if mesh.order != 1:
        raise InputError(
            "elastic prior", expected="linear cells", got="quadratic ones, which reduced models do not know yet",
            fix="fit on simulations with mesh.with_order(1)",
        )
    nodes = probed_nodes(mesh) if nodes is None else np.unique(nodes)
    if not len(nodes) or (mesh.node_part[nodes] > 0).any() or mesh.node_fixed[nodes].any():
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
