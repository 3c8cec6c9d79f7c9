"""Build the elastic prior of a body: one factorization, and a solve for every contact node. Brings the solver."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mixpinn.base.arrays import AnyArray, Float32Array, FloatArray, IntArray
from mixpinn.base.errors import InputError
from mixpinn.base.progress import track
from mixpinn.fem import ElasticSystem, LinearSolver, Material, default_solver
from mixpinn.physics.restraints import FREE, Restraints
from mixpinn.records import TissueMesh
from mixpinn.reduced.basis import response_modes, unlike
from mixpinn.reduced.compliance import DenseCompliance, FactoredCompliance
from mixpinn.reduced.coordinates import ReducedCoordinates
from mixpinn.reduced.load_states import Footprints, draw_loads
from mixpinn.reduced.prior import DENSE_BYTES, ElasticPrior, probed_nodes

_SKIN_WEIGHT = 1e-3
"""What contact nodes count for beside the others in the norm of the modes: their own displacement is known exactly."""


@dataclass(frozen=True)
class FactorConfig:
    """How a compliance is kept that is too large as a whole.

    Attributes:
        dense_bytes: up to this size it is kept whole [byte].
        modes: number of modes r.
        contacts: contacts that the modes are drawn from.
        held_out: further contacts that the error is stated on.
        footprints: how contacts are drawn.

    The numbers of modes and contacts were chosen by hand; what they leave is stated with every prior
    (`ElasticPrior.missed`).
    """

    dense_bytes: int = DENSE_BYTES
    modes: int = 400
    contacts: int = 800
    held_out: int = 60
    footprints: Footprints = field(default_factory=Footprints)


def build_prior(
    mesh: TissueMesh, materials: Sequence[Material], *, nodes: IntArray | None = None,
    linear: LinearSolver | None = None, chunk: int = 96, factors: FactorConfig | None = None,
    restraints: Restraints = FREE,
) -> ElasticPrior:
    """Factorize the rest-state stiffness and solve for every contact node.

    Args:
        mesh: the mesh.
        materials: one for each tissue.
        nodes: contact nodes to prepare, shape (c,); by default `probed_nodes`.
        linear: sparse direct solver.
        chunk: right-hand sides at a time.
        factors: how a compliance is kept that is too large as a whole.
        restraints: joints and foundations, whose stiffness at rest belongs to the body's.

    Raises:
        InputError: a node is fixed or rigid, or there is none.
    """
    nodes = probed_nodes(mesh) if nodes is None else np.unique(nodes)
    factors = factors or FactorConfig()
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
    whole = 4 * len(unknowns) * system.n_dofs <= factors.dense_bytes
    kept = np.arange(system.n_dofs) if whole else unknowns
    compliance = np.empty((len(unknowns), len(kept)), dtype=np.float32)
    for start in track(range(0, len(unknowns), chunk), "elastic prior"):
        columns = unknowns[start : start + chunk]
        forces = np.zeros((system.n_dofs, len(columns)))
        forces[columns, np.arange(len(columns))] = 1.0
        compliance[start : start + len(columns)] = linear.solve(forces)[kept].T
    if whole:
        return ElasticPrior(mesh, nodes, DenseCompliance(compliance), restraints=restraints)
    own = 0.5 * (compliance + compliance.T)
    factored, missed = _factor(mesh, nodes, unknowns, own, linear, factors, chunk)
    return ElasticPrior(mesh, nodes, factored, missed=missed, restraints=restraints)


def _factor(
    mesh: TissueMesh, nodes: IntArray, unknowns: IntArray, own: Float32Array, linear: LinearSolver,
    config: FactorConfig, chunk: int,
) -> tuple[FactoredCompliance, float]:
    """Modes of the responses to drawn contacts and their coefficients, and the error on contacts not drawn from."""
    coordinates = ReducedCoordinates(mesh)
    weights = coordinates.weights.copy()
    weights[unknowns] *= _SKIN_WEIGHT
    loads = draw_loads(
        mesh.node_points[nodes], own.astype(np.float64), config.contacts + config.held_out, config.footprints,
    )
    at_nodes = np.zeros((len(loads), coordinates.size), dtype=np.float32)
    at_nodes[:, unknowns] = loads
    responses = _solve(linear, at_nodes, chunk, "responses")
    modes = response_modes(responses[: config.contacts], weights, config.modes)
    left = _solve(linear, weights**2 * modes, chunk, "modes")[:, unknowns].T
    held_out = responses[config.contacts :]
    right = modes.copy()
    right[:, unknowns] = 0.0
    compliance = FactoredCompliance(np.ascontiguousarray(left), right, own, unknowns)
    rows = np.arange(len(unknowns))
    found = np.array([compliance.respond(rows, load) for load in loads[config.contacts :]])
    missed: FloatArray = unlike(found, held_out, coordinates.weights)
    return compliance, float(np.sqrt((missed**2).mean()))


def _solve(linear: LinearSolver, rows: AnyArray, chunk: int, what: str) -> Float32Array:
    """K⁻¹ of rows (k, D), float32."""
    out = np.empty(rows.shape, dtype=np.float32)
    for start in track(range(0, len(rows), chunk), what):
        part = slice(start, start + chunk)
        out[part] = linear.solve(np.asfortranarray(rows[part].T, dtype=np.float64)).T
    return out
