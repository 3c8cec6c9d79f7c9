"""Steps of the true solver from a prediction: the baseline *prior + k steps*, and the refinement of any prediction."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from mixpinn.base.arrays import AnyArray, Float32Array, FloatArray
from mixpinn.reduced.prior import ContactSystem, ElasticPrior

if TYPE_CHECKING:
    from mixpinn.fem import Material


class NewtonSteps:
    """Newton's method on the equilibrium of the body with the contact nodes held, in double precision.

    The solver is imported when an instance is made. With the rest-state stiffness, factorized once for all samples,
    contact nodes are held through the prior's compliance: δ = −(K⁻¹ r − C_Lᵀ W_LL⁻¹ C_L r). With the stiffness of the
    state, factorized at every step, convergence is quadratic and ends at the finite-element solution.

    Args:
        prior: the linear response.
        materials: one for each tissue.
        steps: steps of `predict`.
    """

    def __init__(self, prior: ElasticPrior, materials: "Sequence[Material]", *, steps: int = 1) -> None:
        from mixpinn.fem import ElasticSystem, default_solver

        self.prior, self.steps = prior, steps
        self.name = f"Prior + {steps} Newton step{'s' if steps > 1 else ''}"
        tied = prior.restraints
        self._system = ElasticSystem(
            prior.mesh, materials, joints=tied.joints, foundations=tied.foundations, membrane=tied.membrane,
        )
        self._rest, self._now = default_solver(), default_solver()
        self._rest.factorize(self._system.tangent(self._system.rest_state(), project=True))

    def predict(self, nodes: AnyArray, displacements: AnyArray) -> Float32Array:
        """Displacement of every node [mm], (n, 3): the prior's and `steps` steps with the rest-state stiffness.

        Args:
            nodes: contact nodes, distinct, shape (l,).
            displacements: of each [mm], shape (l, 3).
        """
        contact = self.prior.hold(nodes)
        force = contact.solve(np.asarray(displacements).ravel())
        unknowns = self.prior.respond_to_forces(contact, force).astype(np.float64)
        return self.prior.expand(self.at_rest_stiffness(unknowns, contact, self.steps))

    def at_rest_stiffness(self, unknowns: FloatArray, contact: ContactSystem, steps: int) -> FloatArray:
        """Unknowns (D,) after `steps` steps with the rest-state stiffness from `unknowns` (D,)."""
        state = self._system.advance(self._system.rest_state(), unknowns)
        for _ in range(steps):
            residual = self._system.residual(self._system.gradient(state), state)
            residual[contact.unknowns] = 0.0
            free = self._rest.solve(residual)
            held = contact.solve(free[contact.unknowns])
            state = self._system.advance(state, self.prior.respond_to_forces(contact, held) - free)
        return self._system.difference(self._system.rest_state(), state)

    def refine(self, unknowns: AnyArray, contact: ContactSystem, steps: int) -> tuple[Float32Array, FloatArray]:
        """Newton steps with the stiffness of the state itself, from `unknowns` (D,).

        Returns:
            Displacement of every node [mm], shape (n, 3), and the norm of the residual before each step and after the
            last one, relative to the force on the contact nodes, shape (steps + 1,).
        """
        held = np.zeros(self._system.n_dofs, dtype=bool)
        held[contact.unknowns] = True
        state = self._system.advance(self._system.rest_state(), np.asarray(unknowns, dtype=np.float64))
        history = []
        for step in range(steps + 1):
            residual = self._system.residual(self._system.gradient(state), state)
            reaction = float(np.linalg.norm(residual[held]))
            residual[held] = 0.0
            history.append(float(np.linalg.norm(residual)) / max(reaction, 1e-12))
            if step < steps:
                self._now.factorize(self._system.tangent(state, held=held, project=False))
                if self._now.indefinite:  # far from equilibrium: a direction of descent is worth more
                    self._now.factorize(self._system.tangent(state, held=held, project=True))
                state = self._system.advance(state, -self._now.solve(residual))
        field = (state.points - self.prior.mesh.node_points).astype(np.float32)
        return field, np.array(history)
