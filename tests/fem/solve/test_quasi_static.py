"""The outer iteration: convergence near the solution, reuse of factorizations, energy at equilibrium."""

import numpy as np

from fem.block_mesh import block, labelled
from mixpinn.fem import (
    PAPER_TISSUE,
    ContactConfig,
    ContactModel,
    ElasticSystem,
    ProbePose,
    QuasiStaticSolver,
    SkinSurface,
    SolverConfig,
)
from mixpinn.geometry.probe_shapes import spherical_probe
from mixpinn.geometry.probe_surface import ProbeSurface

MESH = block((5, 3, 5), size=(40.0, 20.0, 40.0))
MESH = labelled(MESH.points, MESH.cells, fixed=MESH.points[:, 1] == 0.0)
START = ProbePose(np.eye(3), np.array([19.0, 22.0, 21.0]))
PRESSED = ProbePose(np.eye(3), np.array([19.0, 20.8, 21.0]))


def prepared(config: SolverConfig, friction: float = 1.0) -> QuasiStaticSolver:
    probe = ProbeSurface.of_probe(spherical_probe(radius=10.0, subdivisions=3), spacing=2.0)
    contact = ContactModel(SkinSurface.of_mesh(MESH), probe, ContactConfig(friction=friction))
    solver = QuasiStaticSolver(ElasticSystem(MESH, [PAPER_TISSUE]), contact, config)
    solver.begin(contact.reachable(contact.skin.vertices(MESH.points), [START, PRESSED], margin=6.0))
    return solver


def solved(solver: QuasiStaticSolver):
    assert solver.contact is not None
    rest = solver.system.rest_state()
    frame = solver.contact.begin_step(solver.contact.skin.vertices(rest.points), START, None)
    return solver.solve(rest, PRESSED, frame)


def test_a_fresh_tangent_every_time_converges_fast() -> None:
    solver = prepared(SolverConfig(tolerance=1e-8, slow=0.0))
    solution = solved(solver)
    assert solution.converged
    assert len(solution.history) <= 8
    assert solver.effort.factorizations >= len(solution.history) - 3
    # Superlinear at the end: each residual is far below the one before.
    assert solution.history[-1] <= 0.05 * solution.history[-2]


def test_one_factorization_suffices_for_a_step() -> None:
    solver = prepared(SolverConfig())
    solution = solved(solver)
    assert solution.converged
    assert solver.effort.factorizations == 1
    reference = solved(prepared(SolverConfig(tolerance=1e-8, slow=0.0)))
    difference = solution.balance.state.points - reference.balance.state.points
    assert np.abs(difference).max() <= 1e-4


def test_a_solution_is_a_minimum_of_the_energy() -> None:
    solver = prepared(SolverConfig(tolerance=1e-8), friction=0.0)
    solution = solved(solver)
    assert solution.problem is not None
    skin, patch = solver.contact.skin, solver.patch

    def energy(state) -> float:
        positions = skin.vertices(state.points)[patch.vertices]
        return solver.system.energy(state) + solution.problem.evaluate(positions).energy

    lowest, rng = energy(solution.balance.state), np.random.default_rng(0)
    for _ in range(10):
        moved = solver.system.advance(solution.balance.state, rng.normal(scale=1e-3, size=solver.system.n_dofs))
        assert energy(moved) > lowest


def test_held_unknowns_do_not_move() -> None:
    solver = prepared(SolverConfig())
    top = np.flatnonzero((MESH.points[:, 1] == 20.0) & (MESH.points[:, 0] < 17.0))
    solver.held = np.zeros(solver.system.n_dofs, dtype=bool)
    solver.held[solver.system.node_dofs(top).ravel()] = True
    solver.begin(solver.patch)
    solution = solved(solver)
    assert solution.converged
    np.testing.assert_array_equal(solution.balance.state.points[top], MESH.points[top])
    assert solution.balance.contact is not None
    assert solution.balance.contact.hits > 0


def test_a_patch_without_skin_means_no_contact() -> None:
    solver = prepared(SolverConfig())
    solver.begin(None)
    solution = solved(solver)
    assert solution.converged
    assert solution.balance.contact is None
    np.testing.assert_array_equal(solution.balance.state.points, MESH.points)


def test_the_effort_is_counted() -> None:
    solver = prepared(SolverConfig())
    solution = solved(solver)
    effort = solver.effort
    assert effort.iterations == len(solution.history) - 1
    assert effort.evaluations >= effort.iterations + 1
    assert effort.contact_iterations >= effort.iterations
    assert all(seconds > 0.0 for seconds in effort.seconds.values())
