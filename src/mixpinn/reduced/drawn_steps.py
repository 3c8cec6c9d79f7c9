"""Newton steps of contacts that nobody simulated: fields that the modes of few simulations do not hold.

What the prior misses at a place depends on the tissue there, so that modes of simulations at a dozen places cannot
carry what is missed between them. Its first approximation needs no simulation: one Newton step from the prior's answer,

    δ = −(K⁻¹ r − C_L W_LL⁻¹ C_Lᵀ r),

as in `mixpinn.reduced.modal_newton`, here in all unknowns, for footprints drawn all over the prepared skin
(`mixpinn.reduced.load_states`).
"""

import numpy as np

from mixpinn.base.arrays import Float32Array
from mixpinn.base.progress import track
from mixpinn.fem import LinearSolver
from mixpinn.reduced.equilibrium import Equilibrium
from mixpinn.reduced.load_states import Footprints, draw_loads
from mixpinn.reduced.prior import ContactSystem, ElasticPrior

_CHUNK = 96
"""Right-hand sides at a time."""


def drawn_steps(
    prior: ElasticPrior, equilibrium: Equilibrium, linear: LinearSolver, count: int,
    footprints: Footprints | None = None,
) -> Float32Array:
    """Newton steps from the prior's answers to drawn contacts [mm, rad], float32, shape (count, D).

    Args:
        prior: the linear response.
        equilibrium: the nonlinear residual.
        linear: solver that holds the stiffness at rest.
        count: number of contacts.
        footprints: how they are drawn.
    """
    space = prior.coordinates
    loads = draw_loads(prior.mesh.node_points[prior.nodes], prior.own_compliance, count, footprints)
    steps = np.empty((count, space.size), dtype=np.float32)
    for start in track(range(0, count, _CHUNK), "drawn contacts"):
        contacts: list[ContactSystem] = []
        residuals = []
        for load in loads[start : start + _CHUNK]:
            touched = np.flatnonzero(load.reshape(-1, 3).any(axis=1))
            contact = prior.hold(prior.nodes[touched])
            residual = equilibrium.residual(prior.respond_to_forces(contact, load[contact.rows]), space)
            residual[contact.unknowns] = 0.0
            contacts.append(contact)
            residuals.append(residual)
        free = linear.solve(np.asfortranarray(np.array(residuals, dtype=np.float64).T)).T
        for step, moved, contact in zip(steps[start:], free, contacts, strict=False):
            step[:] = prior.respond_to_forces(contact, contact.solve(moved[contact.unknowns])) - moved
    return steps
