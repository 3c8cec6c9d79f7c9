"""Newton's method on the exact tangent, without contact: for problems whose boundary displacements are prescribed."""

from dataclasses import dataclass

import numpy as np

from mixpinn.base.arrays import BoolArray, FloatArray
from mixpinn.fem import ElasticSystem, LinearSolver, State, SuperLUSolver
from mixpinn.fem.solve.linear import symmetric_product


@dataclass(frozen=True)
class Equilibrium:
    """A state in equilibrium and the norm of the residual before each iteration and at the end [N]."""

    state: State
    history: list[float]
    converged: bool


def equilibrium(
    system: ElasticSystem, state: State, *, held: BoolArray | None = None, shift: FloatArray | None = None,
    load: FloatArray | None = None, tolerance: float = 1e-12, limit: int = 30, linear: LinearSolver | None = None,
    project: bool = False,
) -> Equilibrium:
    """Find equilibrium.

    Args:
        system: elastic bodies.
        state: starting guess.
        held: unknowns that keep their value, shape (n_dofs,).
        shift: increments imposed on the held unknowns in the first iteration, shape (n_dofs,).
        load: forces on the nodes [N], shape (n, 3).
        tolerance: of the norm of the residual over the free unknowns [N].
        limit: of the iterations.
        linear: solver of the linear systems.
        project: use the tangent without negative eigenvalues of single cells.
    """
    linear = linear or SuperLUSolver()
    held = np.zeros(system.n_dofs, dtype=bool) if held is None else held
    load = np.zeros_like(state.points) if load is None else load
    history: list[float] = []
    for iteration in range(limit + 1):
        nodal = system.gradient(state) - load
        residual = system.residual(nodal, state)
        if shift is None:
            history.append(float(np.linalg.norm(residual[~held])))
            if history[-1] <= tolerance or iteration == limit:
                break
        matrix = system.tangent(state, nodal_gradient=nodal, project=project)
        rhs = -residual
        if shift is not None:
            rhs -= symmetric_product(matrix, np.where(held, shift, 0.0))
        rhs[held] = 0.0 if shift is None else shift[held]
        linear.factorize(system.hold(matrix, held))
        state, shift = system.advance(state, linear.solve(rhs)), None
    return Equilibrium(state, history, history[-1] <= tolerance)
