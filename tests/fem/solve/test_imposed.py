"""Imposed displacements, against affine motion and by their balance."""

import numpy as np
import pytest

from fem.block_mesh import block, labelled, two_bones
from mixpinn.base.errors import InputError
from mixpinn.fem import PAPER_TISSUE, ElasticSystem, LinearElastic, SolverConfig, solve_imposed


def test_an_affine_motion_of_the_boundary_moves_the_inside_alike() -> None:
    mesh = block((3, 3, 3), size=(30.0, 30.0, 30.0), shake=0.25)
    system = ElasticSystem(mesh, [PAPER_TISSUE])
    boundary = np.unique(mesh.boundary_faces)
    slope = np.array([[0.1, 0.05, 0.0], [0.0, -0.15, 0.02], [0.03, 0.0, 0.05]])
    steps = [(boundary, factor * mesh.points[boundary] @ slope.T) for factor in (0.5, 1.0)]
    found = solve_imposed(system, steps, config=SolverConfig(tolerance=1e-10))
    assert found.converged.all()
    for step, factor in enumerate((0.5, 1.0)):
        np.testing.assert_allclose(found.displacement[step], factor * mesh.points @ slope.T, atol=1e-7)


def test_a_linear_body_answers_in_one_iteration() -> None:
    mesh = block((3, 2, 2), size=(30.0, 20.0, 20.0))
    mesh = labelled(mesh.points, mesh.cells, fixed=mesh.points[:, 0] == 0.0)
    system = ElasticSystem(mesh, [LinearElastic(mu=1.0, lam=2.0)])
    end = np.flatnonzero(mesh.points[:, 0] == 30.0)
    found = solve_imposed(system, [(end, np.tile([1.0, 0.0, 0.0], (len(end), 1)))], config=SolverConfig(tolerance=1e-9))
    assert found.converged[0]
    assert found.iterations[0] <= 1


def test_reactions_balance_and_bones_are_in_equilibrium() -> None:
    mesh = two_bones()
    system = ElasticSystem(mesh, [PAPER_TISSUE])
    top = np.flatnonzero((mesh.points[:, 2] > 29.9) & (mesh.part == 0))[:12]
    steps = [(top[:6], np.tile([0.0, 0.0, -1.0], (6, 1))), (top, np.tile([0.5, 0.0, -2.0], (12, 1)))]
    found = solve_imposed(system, steps, config=SolverConfig(tolerance=1e-9))
    assert found.converged.all()
    np.testing.assert_allclose(found.displacement[1][top], steps[1][1], atol=1e-12)
    for step, (nodes, _) in enumerate(steps):
        gradient = found.gradient[step]
        scale = np.abs(gradient).sum()
        free = (mesh.part == 0) & ~mesh.fixed
        free[nodes] = False
        assert np.abs(gradient[free]).max() <= 1e-6 * scale
        held = np.concatenate([nodes, np.flatnonzero(mesh.fixed)])
        assert np.abs(gradient[held].sum(axis=0)).max() <= 1e-6 * scale
        for k in (1, 2):
            assert np.abs(gradient[mesh.part == k].sum(axis=0)).max() <= 1e-6 * scale


def test_a_step_that_cannot_be_taken_is_reported() -> None:
    mesh = block((2, 2, 2), size=(20.0, 20.0, 20.0))
    mesh = labelled(mesh.points, mesh.cells, fixed=mesh.points[:, 0] == 0.0)
    system = ElasticSystem(mesh, [PAPER_TISSUE])
    end = np.flatnonzero(mesh.points[:, 0] == 20.0)
    steps = [(end, np.tile([1.0, 0.0, 0.0], (9, 1))), (end, np.tile([2.0, 0.0, 0.0], (9, 1)))]
    found = solve_imposed(system, steps, config=SolverConfig(tolerance=1e-30, max_cuts=1))
    assert not found.converged.any()
    assert np.isfinite(found.residual[0])


def test_rigid_fixed_and_repeated_nodes_are_refused() -> None:
    mesh = two_bones()
    system = ElasticSystem(mesh, [PAPER_TISSUE])
    soft = np.flatnonzero((mesh.part == 0) & ~mesh.fixed)[0]
    for nodes in (np.flatnonzero(mesh.part == 1)[:1], np.flatnonzero(mesh.fixed)[:1], np.array([soft, soft])):
        with pytest.raises(InputError, match="free soft"):
            solve_imposed(system, [(nodes, np.zeros((len(nodes), 3)))])
