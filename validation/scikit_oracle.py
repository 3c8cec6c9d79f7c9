"""Linear elasticity by scikit-fem: another code's displacement of a loaded, clamped body on the same mesh."""

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp
import skfem
from skfem.helpers import ddot, eye, sym_grad, trace

from mixpinn.base.arrays import FloatArray, IntArray
from mixpinn.fem import ElasticSystem, LinearElastic, LinearSolver
from mixpinn.records import TissueMesh
from mixpinn.records.mid_edges import edge_index
from validation.blocks import block, labelled
from validation.newton import equilibrium


def scikit_stiffness(mesh: TissueMesh, materials: Sequence[LinearElastic]) -> tuple[sp.csr_matrix, IntArray]:
    """Stiffness of a body of order 1 or 2 with a material for each tissue, and each node's unknowns, shape (n, 3)."""
    element = skfem.ElementTetP1() if mesh.order == 1 else skfem.ElementTetP2()
    basis = skfem.Basis(
        skfem.MeshTet(mesh.points.T.copy(), mesh.cells.T.astype(np.int64).copy()),
        skfem.ElementVector(element), intorder=mesh.order,
    )
    constant, tissue = basis.with_element(skfem.ElementTetP0()), mesh.tissue.astype(int)
    mu = constant.interpolate(np.array([material.mu for material in materials])[tissue])
    lam = constant.interpolate(np.array([material.lam for material in materials])[tissue])

    @skfem.BilinearForm
    def stiffness(u, v, w):  # type: ignore[no-untyped-def]
        strain = sym_grad(u)
        return ddot(2.0 * w.mu * strain + w.lam * eye(trace(strain), 3), sym_grad(v))

    unknown = basis.nodal_dofs.T
    if mesh.order == 2:  # its unknowns lie at the vertices and at the midpoints of its own edges
        own = np.argsort(edge_index(mesh, basis.mesh.edges.T))
        unknown = np.concatenate([unknown, basis.edge_dofs.T[own]])
    return stiffness.assemble(basis, mu=mu, lam=lam), unknown


def scikit_displacement(mesh: TissueMesh, material: LinearElastic, load: FloatArray) -> FloatArray:
    """Displacement of every node [mm], shape (n, 3), under forces on the nodes [N], shape (n, 3); order 1 or 2."""
    stiffness, unknown = scikit_stiffness(mesh, [material])
    rhs = np.zeros(unknown.size)
    rhs[unknown] = load
    found: FloatArray = skfem.solve(*skfem.condense(stiffness, rhs, D=unknown[mesh.node_fixed].ravel()))[unknown]
    return found


def oracle_difference(
    counts: tuple[int, int, int], *, order: int, linear: LinearSolver | None = None, mirrored: bool = True,
) -> float:
    """Largest difference from scikit-fem on a shaken, clamped block under random forces, relative to the largest."""
    rng = np.random.default_rng(0)
    mesh = block(counts, size=(2.0, 1.0, 1.0), shake=0.25, rng=rng, mirrored=mirrored)
    mesh = labelled(mesh.points, mesh.cells, fixed=mesh.points[:, 0] < 1e-9).with_order(order)
    material = LinearElastic.from_young(3.0, 0.4)
    system = ElasticSystem(mesh, [material])
    load = rng.normal(size=mesh.node_points.shape)
    found = equilibrium(system, system.rest_state(), load=load, tolerance=1e-9, linear=linear)
    expected = scikit_displacement(mesh, material, load)
    return float(np.abs(found.state.points - mesh.node_points - expected).max() / np.abs(expected).max())
