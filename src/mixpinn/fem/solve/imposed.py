"""Quasi-static solve with the displacement of chosen nodes imposed, and no contact."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from mixpinn.base.arrays import BoolArray, FloatArray, IntArray
from mixpinn.base.errors import InputError, SolveError
from mixpinn.fem.elements.system import ElasticSystem, State
from mixpinn.fem.solve.linear import LinearSolver
from mixpinn.fem.solve.quasi_static import QuasiStaticSolver, SolverConfig


@dataclass(frozen=True, eq=False)
class ImposedSolution:
    """Equilibria under imposed displacements; s steps, n mesh nodes, K rigid parts.

    Attributes:
        displacement: of every mesh node [mm], shape (s, n, 3).
        rotation: rotation matrix of each rigid part, shape (s, K, 3, 3).
        translation: displacement of the centroid of each rigid part [mm], shape (s, K, 3).
        gradient: derivative of the elastic energy by node positions [N], shape (s, n, 3): at nodes that are imposed
            or fixed, the force that holds them.
        converged: whether the step met its tolerance, shape (s,); after one that did not, all others did not either
            and repeat the last converged configuration.
        residual: relative residual at the end of each step, shape (s,).
        iterations: of each step, shape (s,).
    """

    displacement: FloatArray
    rotation: FloatArray
    translation: FloatArray
    gradient: FloatArray
    converged: BoolArray
    residual: FloatArray
    iterations: IntArray


def solve_imposed(
    system: ElasticSystem, steps: Sequence[tuple[IntArray, FloatArray]], *, config: SolverConfig | None = None,
    linear: LinearSolver | None = None, on_step: Callable[[int], None] | None = None,
) -> ImposedSolution:
    """Equilibrium at each of several steps, each warm-started from the one before.

    Args:
        system: the body.
        steps: for each step, the nodes, distinct, shape (k,), and their displacement from rest [mm], shape (k, 3).
            The nodes may differ from step to step; those no longer named are free again.
        config: tolerances and limits; a step that does not converge is halved up to `SolverConfig.max_cuts` times.
        linear: sparse direct solver; by default the best that the platform has.
        on_step: called with the number of each finished step.

    Raises:
        InputError: a node that is fixed, rigid or named twice, or displacements of another shape.
    """
    config = config or SolverConfig()
    held = [_held(system, nodes, displacement) for nodes, displacement in steps]
    solver = QuasiStaticSolver(system, None, config, linear=linear)
    rest = state = system.rest_state()
    n_steps, n_parts = len(steps), len(rest.rotation)
    result = ImposedSolution(
        np.zeros((n_steps, *rest.points.shape)), np.zeros((n_steps, n_parts, 3, 3)), np.zeros((n_steps, n_parts, 3)),
        np.zeros((n_steps, *rest.points.shape)), np.zeros(n_steps, dtype=bool), np.full(n_steps, np.nan),
        np.zeros(n_steps, dtype=np.int64),
    )
    going = True
    for step, (nodes, displacement) in enumerate(steps):
        if going:
            before = solver.effort.iterations
            solver.held = held[step]
            solver.begin(None)
            found, residual = _advance(solver, state, nodes, rest.points[nodes] + displacement, config.max_cuts)
            result.residual[step], result.iterations[step] = residual, solver.effort.iterations - before
            going = result.converged[step] = found is not None
            state = state if found is None else found
        result.displacement[step] = state.points - rest.points
        result.rotation[step], result.translation[step] = state.rotation, state.translation
        result.gradient[step] = system.gradient(state)
        if on_step is not None:
            on_step(step)
    return result


def _held(system: ElasticSystem, nodes: IntArray, displacement: FloatArray) -> BoolArray:
    unknowns = system.node_dofs(nodes)
    if (unknowns < 0).any() or len(np.unique(nodes)) != len(nodes) or np.shape(displacement) != (len(nodes), 3):
        raise InputError(
            "imposed displacements", expected="distinct free soft nodes with three components each",
            got=f"{int((unknowns < 0).any(axis=1).sum())} fixed or rigid of {len(nodes)} nodes, displacements of shape "
                f"{np.shape(displacement)}",
            fix="impose displacements on free soft nodes only",
        )
    held = np.zeros(system.n_dofs, dtype=bool)
    held[unknowns.ravel()] = True
    return held


def _advance(
    solver: QuasiStaticSolver, state: State, nodes: IntArray, target: FloatArray, cuts: int,
) -> tuple[State | None, float]:
    """Go from equilibrium `state` to nodes at `target` [mm], in halves where needed."""
    increment = np.zeros(solver.system.n_dofs)
    increment[solver.system.node_dofs(nodes).ravel()] = (target - state.points[nodes]).ravel()
    try:
        solution = solver.solve(solver.displace(state, increment))
    except SolveError:
        return None, np.nan
    if solution.converged:
        return solution.balance.state, solution.history[-1]
    if cuts == 0:
        return None, solution.history[-1]
    half, residual = _advance(solver, state, nodes, 0.5 * (state.points[nodes] + target), cuts - 1)
    return (None, residual) if half is None else _advance(solver, half, nodes, target, cuts - 1)
