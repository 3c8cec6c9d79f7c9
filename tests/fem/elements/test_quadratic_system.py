"""Ten-node cells in the elastic system: derivatives, invariance, exactness and order of convergence."""

import numpy as np
import pytest

from fem.block_mesh import block, carved, labelled, two_bones
from fem.elements.system_checks import (
    MATERIALS,
    SOFT,
    check_derivatives,
    check_threads,
    check_user_materials,
    equilibrium,
    large_motion,
    outer,
)
from mixpinn.fem.elements.system import ElasticSystem, State
from mixpinn.fem.material.hyperelastic import LinearElastic
from mixpinn.geometry.rotations import rotation_from_vector
from mixpinn.records.mid_edges import edge_index
from validation.linear_elasticity import manufactured_error, order_of_convergence
from validation.scikit_oracle import oracle_difference


def bones(counts=(6, 3, 3)):
    return carved(two_bones(counts)).with_order(2)


@pytest.mark.parametrize("material", MATERIALS, ids=repr)
def test_energy_gradient_and_tangent_agree(material):
    system = ElasticSystem(bones(), [material])
    check_derivatives(system, large_motion(system, scatter=0.5), directions=3)


@pytest.mark.parametrize("project", [True, False])
def test_materials_of_the_user_and_several_tissues(project):
    mesh = carved(two_bones())
    tissue = np.arange(len(mesh.cells)) % 3
    mesh = labelled(mesh.points, mesh.cells, part=mesh.part, fixed=mesh.fixed, tissue=tissue).with_order(2)
    check_user_materials(mesh, project=project, scatter=0.5)


def test_results_do_not_depend_on_threads():
    mesh = block((9, 8, 8), shake=0.2)
    mesh = labelled(mesh.points, mesh.cells, fixed=mesh.points[:, 0] < 1e-9).with_order(2)
    check_threads(mesh, scatter=0.005)


def test_linear_elasticity_against_scikit_fem():
    assert oracle_difference((4, 3, 3), order=2, mirrored=False) <= 1e-8


def test_displacement_converges_with_order_three():
    sizes = (2, 4, 6)
    errors = [manufactured_error(n, order=2, mirrored=False) for n in sizes]
    assert 2.8 <= order_of_convergence(sizes, errors) <= 3.2


@pytest.mark.parametrize("material", MATERIALS[:2], ids=repr)
def test_no_force_under_rigid_motion(material):
    mesh = bones((3, 2, 2))
    mesh = labelled(mesh.points, mesh.cells, part=mesh.part).with_order(2)
    system = ElasticSystem(mesh, [material])
    turn, shift = rotation_from_vector(np.array([0.9, -1.4, 0.6])), np.array([10.0, -4.0, 7.0])
    points = mesh.node_points @ turn.T + shift
    centroids = np.array([mesh.points[mesh.part == k].mean(axis=0) for k in (1, 2)])
    state = system.place(points, np.tile(turn, (2, 1, 1)), centroids @ turn.T + shift - centroids)
    np.testing.assert_allclose(state.points, points, atol=1e-12)
    assert np.abs(system.gradient(system.rest_state())).max() == 0.0
    assert np.abs(system.gradient(state)).max() <= 1e-12 * material.mu * 30.0**2
    np.testing.assert_allclose(system.jacobians(state), 1.0, atol=1e-12)
    np.testing.assert_allclose(system.vertex_jacobians(state), 1.0, atol=1e-12)


@pytest.mark.parametrize("material", MATERIALS, ids=repr)
def test_affine_patch(material):
    mesh = block((3, 3, 3), shake=0.25).with_order(2)
    system = ElasticSystem(mesh, [material])
    affine = np.array([[0.15, 0.1, -0.05], [0.02, -0.1, 0.08], [0.12, 0.0, 0.05]])
    exact = mesh.node_points @ affine.T
    held = np.repeat(outer(mesh), 3)
    state, _ = equilibrium(system, system.rest_state(), held, shift=np.where(held, exact.ravel(), 0.0))
    assert np.abs(state.points - mesh.node_points - exact).max() <= 1e-10
    energy = material.energy((np.eye(3) + affine)[None])[0]
    assert system.energy(state) == pytest.approx(energy, rel=1e-10)
    # Under uniform stress vertices inside a face carry nothing and midpoints a third of their faces each.
    stress = material.gradient((np.eye(3) + affine)[None])[0]
    force = system.gradient(state)
    np.testing.assert_allclose(force[mesh.node_points[:, 0] > 1.0 - 1e-9].sum(axis=0) * [1, 0, 0], [0, 0, 0], atol=9.0)
    inner = (mesh.points[:, 0] > 1.0 - 1e-9) & (np.abs(mesh.points[:, 1:] - 0.5) < 0.4).all(axis=1)
    assert np.abs(force[: mesh.n_points][inner]).max() <= 1e-10
    seen = mesh.on_vertices(force)[inner]
    np.testing.assert_allclose(seen, np.tile(stress[:, 0] / 9.0, (len(seen), 1)), atol=1e-10)


def test_a_quadratic_field_bends_the_cells_as_it_should():
    # F is linear within a cell, J cubic: the rule of 14 points integrates the energy of J − 1 to degree 5 at least.
    mesh = block((2, 1, 1), shake=0.0).with_order(2)
    system = ElasticSystem(mesh, [LinearElastic(mu=1.0, lam=1.5)])
    x, y, z = mesh.node_points.T
    moved = 0.1 * np.stack([x * x + y * z, x * y - z * z, y * y + x], axis=1)
    state = State(mesh.node_points + moved, np.empty((0, 3, 3)), np.empty((0, 3)))
    # ε of that field, integrated exactly: W = μ ε:ε + λ/2 (tr ε)², a polynomial of degree 2, by a 3-point Gauss rule
    places, weights = np.polynomial.legendre.leggauss(3)
    grid = np.stack(np.meshgrid(*[0.5 * (places + 1.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    share = np.einsum("i,j,k->ijk", *[0.5 * weights] * 3).ravel()
    u, v, w = grid.T
    h = 0.1 * np.array([[2 * u, w, v], [v, u, -2 * w], [np.ones_like(u), 2 * v, np.zeros_like(u)]])
    strain = 0.5 * (h + h.transpose(1, 0, 2))
    density = (strain**2).sum(axis=(0, 1)) + 0.75 * np.trace(strain) ** 2
    assert system.energy(state) == pytest.approx(density @ share, rel=1e-12)


def test_jacobians_are_taken_where_the_cell_is_bent():
    # One cell whose midpoint of the edge 0–1 is pushed towards vertex 0: near it, lengths along the edge shrink.
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
    mesh = labelled(points, np.array([[0, 1, 2, 3]])).with_order(2)
    system = ElasticSystem(mesh, [SOFT])
    moved = mesh.node_points.copy()
    moved[4 + edge_index(mesh, np.array([0, 1])), 0] -= 0.25
    state = State(moved, np.empty((0, 3, 3)), np.empty((0, 3)))
    # x = X − ¼ · 4 λ₀ λ₁, hence ∂x/∂X = 1 − (λ₀ − λ₁): zero at vertex 0, 1 − (α − β) at the nearest quadrature point
    assert system.vertex_jacobians(state) == pytest.approx(0.0, abs=1e-12)
    assert system.jacobians(state) == pytest.approx(1.0 - 1.0 / np.sqrt(5.0))
