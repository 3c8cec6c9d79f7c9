"""One Newton step of the true, nonlinear equilibrium, read off in few modes at the price of three small products.

At a state with residual r on the unknowns that contact does not hold, Newton's method with the rest-state stiffness K
and the contact nodes L held moves the unknowns by

    δ = −(K⁻¹ r − C_L W_LL⁻¹ C_Lᵀ r),

C = K⁻¹ Sᵀ the compliance of the elastic prior and W = S C its own block. Only its coefficients in orthonormal modes Ψ
are wanted, Ψ M δ with M the weights. They need K⁻¹ for the modes alone, once: with the duals Φ = Ψ M K⁻¹ and T = Ψ M C,

    Ψ M δ = −(Φ r − T_L W_LL⁻¹ C_Lᵀ r).

The step is exact, however few modes there are; no linear system of the mesh's size is solved. On a mesh of many cells
r is summed over those near the contact nodes alone (`mixpinn.reduced.near_cells`).
"""

from dataclasses import dataclass, replace

import numpy as np

from mixpinn.base.arrays import AnyArray, Float32Array, FloatArray
from mixpinn.reduced.compliance.rows import Rows
from mixpinn.reduced.equilibrium import Equilibrium
from mixpinn.reduced.near_cells import NearCells
from mixpinn.reduced.prior import ContactSystem, ElasticPrior


@dataclass(frozen=True, eq=False)
class ModalNewton:
    """Newton steps of a body in the coefficients of m modes.

    Attributes:
        prior: the linear response.
        equilibrium: the nonlinear residual.
        modes: Ψ, orthonormal, shape (m, D).
        duals: Φ = Ψ M K⁻¹, shape (m, D).
        coupling: T = Ψ M C, shape (m, 3 c).
        near: cells that the residual is summed over; None sums over all.
    """

    prior: ElasticPrior
    equilibrium: Equilibrium
    modes: Rows
    duals: Rows
    coupling: Float32Array
    near: NearCells | None = None

    def leading(self, count: int) -> "ModalNewton":
        """With the first `count` modes."""
        return replace(
            self, modes=self.modes.first(count), duals=self.duals.first(count),
            coupling=np.ascontiguousarray(self.coupling[:count]),
        )

    def step(self, unknowns: AnyArray, contact: ContactSystem, moved: AnyArray | None = None) -> Float32Array:
        """Coefficients of the Newton step [mm times the root of the number of nodes], shape (m,).

        Args:
            unknowns: the state, at which the contact nodes are where they are imposed to be, shape (D,).
            contact: the contact nodes that are held.
            moved: how far the state is from the prior's answer [mm, rad], shape (D,); None: it is that answer.
        """
        step = self.step_of_residual(self.residual(unknowns, contact), contact)
        if self.near is None or moved is None:
            return step
        # What linear elasticity leaves unbalanced at the state, K `moved`, is not in the residual: it leads back.
        weights = self.prior.coordinates.weights
        return step - self.modes.times(weights**2 * np.asarray(moved, dtype=np.float32))

    def residual(self, unknowns: AnyArray, contact: ContactSystem) -> Float32Array:
        """Unbalanced force on each unknown [N, N mm], zero on those that contact holds, shape (D,)."""
        coordinates = self.prior.coordinates
        residual = (
            self.equilibrium.residual(unknowns, coordinates) if self.near is None
            else self.near.residual(unknowns, coordinates, contact.rows)
        )
        residual[contact.unknowns] = 0.0
        return residual

    def step_of_residual(self, residual: Float32Array, contact: ContactSystem) -> Float32Array:
        """`step` for a residual (D,) that is zero on the held unknowns."""
        moved = self.prior.compliance.read(contact.rows, residual)
        held: FloatArray = contact.solve(moved)
        return -(self.duals.times(residual) - self.coupling[:, contact.rows] @ held.astype(np.float32))

    def add_modes(self, coefficients: Float32Array, unknowns: Float32Array) -> Float32Array:
        """`unknowns` (D,) and Σ_i z_i ψ_i for coefficients z (m,)."""
        moved = unknowns.copy()
        self.modes.add_to(moved, coefficients)
        return moved
