"""The skin's membrane against closed forms, by finite differences, and in a body."""

from dataclasses import replace

import numpy as np
import pytest
import pyvista as pv
from numpy.testing import assert_allclose

from fem.block_mesh import block
from mixpinn.base.errors import InputError
from mixpinn.fem import ElasticSystem, SolverConfig, StableNeoHookean, SuperLUSolver, solve_imposed
from mixpinn.geometry.rotations import rotation_from_vector
from mixpinn.physics.membrane import Membrane, MembraneSystem, face_shapes
from mixpinn.physics.membrane_kernel import add_membrane_forces
from mixpinn.physics.restraints import Restraints

TISSUE = StableNeoHookean.from_young(25.4e-3, 0.45)
BOTH = Membrane(shear=0.3, tension=0.02)


def body(order: int = 1):
    return block((2, 3, 4), size=(20.0, 30.0, 40.0), shake=0.2).with_order(order)


def bent(mesh, size: float = 1.0):
    rng = np.random.default_rng(5)
    return size * rng.standard_normal(mesh.node_points.shape)


def area_of(mesh, faces) -> float:
    a, b, c = (mesh.points[faces[:, k]] for k in range(3))
    return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("stretch", [0.8, 1.0, 1.6])
def test_a_closed_surface_is_inflated_as_in_closed_form(order, stretch) -> None:
    """Any closed surface scaled by λ: E = A [½ μh (2λ² + λ⁻⁴ − 3) + γ ((λ² − 1) − 2 (λ − 1))], and its derivative.

    For a sphere of radius R the derivative over 4π R λ² R is the pressure of Laplace and of a balloon,
    p = (2 / λ² R) [μh (λ − λ⁻⁵) + γ (λ − 1)].
    """
    mesh = body(order)
    system = MembraneSystem(BOTH, mesh, faces=mesh.skin_node_faces)
    area, moved = area_of(mesh, mesh.skin_faces), (stretch - 1.0) * mesh.node_points
    elastic, tension = BOTH.shear * area, BOTH.tension * area
    expected = 0.5 * elastic * (2 * stretch**2 + stretch**-4 - 3.0) + tension * (stretch**2 - 1.0 - 2 * (stretch - 1.0))
    assert system.energy(moved) == pytest.approx(expected, rel=1e-10, abs=1e-9)
    forces = np.zeros_like(mesh.node_points)
    system.add_forces(moved, forces)
    slope = 2.0 * elastic * (stretch - stretch**-5) + tension * (2.0 * stretch - 2.0)
    assert float((forces * mesh.node_points).sum()) == pytest.approx(slope, rel=1e-10, abs=1e-9)


def test_the_pressure_in_a_sphere_under_tension_is_that_of_laplace() -> None:
    """p = 2γ / R: the forces of a surface tension on an inscribed polyhedron, finer and finer."""
    errors = []
    for level in (2, 3, 4):
        sphere = pv.Icosphere(radius=7.0, nsub=level)
        points, faces = np.array(sphere.points, dtype=float), sphere.faces.reshape(-1, 4)[:, 1:].astype(np.int64)
        forces = np.zeros_like(points)
        add_membrane_forces(faces, points, *face_shapes(points, faces), 0.0, 0.02, forces)
        outward = float((forces * points).sum()) / 7.0
        errors.append(outward / (4.0 * np.pi * 49.0) / (2.0 * 0.02 / 7.0) - 1.0)
    assert abs(errors[-1]) < 5e-3
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.1)


@pytest.mark.parametrize("order", [1, 2])
def test_a_strip_that_may_narrow_resists_as_in_closed_form(order) -> None:
    """Uniaxial stress: the strip narrows by λ^-1/2, its force per width is μh (λ − λ⁻²), and E h = 3 μh at small λ."""
    mesh = body(order)
    top = mesh.skin_node_faces[(mesh.points[mesh.skin_faces][:, :, 1] > 29.9).all(axis=1)]
    system = MembraneSystem(Membrane(shear=0.3), mesh, faces=top)
    stretch = 1.3
    scale = np.array([stretch, 1.0, stretch**-0.5])
    forces = np.zeros_like(mesh.node_points)
    system.add_forces((scale - 1.0) * mesh.node_points, forces)
    right = mesh.node_points[:, 0] > 19.9
    assert forces[right, 0].sum() == pytest.approx(40.0 * 0.3 * (stretch - stretch**-2), rel=1e-10)
    side = mesh.node_points[:, 2] > 39.9
    assert forces[side, 2].sum() == pytest.approx(0.0, abs=1e-10)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("membrane", [Membrane(shear=0.3), Membrane(tension=0.02), BOTH])
def test_forces_and_stiffness_are_the_derivatives(order, membrane) -> None:
    mesh = body(order)
    system = MembraneSystem(membrane, mesh)
    assert 0 < len(system) < len(mesh.skin_faces)  # without the caps
    moved, way, h = bent(mesh), bent(mesh)[::-1].copy(), 1e-5
    sides = []
    for sign in (1.0, -1.0):
        forces = np.zeros_like(moved)
        system.add_forces(moved + sign * h * way, forces)
        sides.append((system.energy(moved + sign * h * way), forces))
    here = np.zeros_like(moved)
    system.add_forces(moved, here)
    slope = (sides[0][0] - sides[1][0]) / (2 * h)
    assert slope == pytest.approx(float((here * way).sum()), rel=1e-6)
    first, second, blocks = system.stiffness(moved)
    found = np.zeros_like(moved)
    np.add.at(found, first, np.einsum("bde,be->bd", blocks, way[second]))
    off = first != second
    np.add.at(found, second[off], np.einsum("bed,be->bd", blocks[off], way[first[off]]))
    expected = (sides[0][1] - sides[1][1]) / (2 * h)
    assert_allclose(found, expected, rtol=0.0, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("order", [1, 2])
def test_the_projected_stiffness_has_no_negative_eigenvalue_but_the_tensions(order) -> None:
    mesh = body(order)
    system = MembraneSystem(Membrane(shear=0.3), mesh)
    first, second, blocks = system.stiffness(-0.3 * mesh.node_points + bent(mesh, 0.5), project=True)
    dense = np.zeros((mesh.n_nodes, 3, mesh.n_nodes, 3))
    for i, j, part in zip(first, second, blocks, strict=True):
        dense[i, :, j] += part
        if i != j:
            dense[j, :, i] += part.T
    values = np.linalg.eigvalsh(dense.reshape(3 * mesh.n_nodes, -1))
    assert values[0] > -1e-9 * values[-1]
    both = MembraneSystem(BOTH, mesh)
    exact, projected = (both.stiffness(np.zeros_like(mesh.node_points), project=way)[2] for way in (False, True))
    assert_allclose(projected, exact, atol=1e-12 * np.abs(exact).max())  # at rest nothing is left out


def test_what_is_elastic_is_objective() -> None:
    mesh = body()
    turn = rotation_from_vector(np.array([0.4, -0.7, 0.2]))
    system, moved = MembraneSystem(Membrane(shear=0.3), mesh), bent(mesh)
    turned = (mesh.node_points + moved) @ turn.T - mesh.node_points
    assert system.energy(turned) == pytest.approx(system.energy(moved), rel=1e-12)
    here, there = np.zeros_like(moved), np.zeros_like(moved)
    system.add_forces(moved, here)
    system.add_forces(turned, there)
    assert_allclose(there, here @ turn.T, atol=1e-12 * np.abs(here).max())


@pytest.mark.parametrize("order", [1, 2])
def test_a_body_with_skin_is_in_balance_at_rest_and_its_tangent_is_the_derivative(order) -> None:
    mesh = body(order)
    system = ElasticSystem(mesh, [TISSUE], membrane=BOTH)
    rest = system.rest_state()
    assert np.abs(system.gradient(rest)).max() < 1e-12
    rng, h = np.random.default_rng(2), 1e-6
    state = system.advance(rest, 0.3 * rng.standard_normal(system.n_dofs))
    way = rng.standard_normal(system.n_dofs)
    ahead, behind = (system.advance(state, sign * h * way) for sign in (1.0, -1.0))
    upper = system.tangent(state, project=False).toarray()
    found = (upper + np.triu(upper, 1).T) @ way
    expected = (system.reduce(system.gradient(ahead), ahead) - system.reduce(system.gradient(behind), behind)) / (2 * h)
    assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())
    slope = (system.energy(ahead) - system.energy(behind)) / (2 * h)
    assert slope == pytest.approx(float(system.reduce(system.gradient(state), state) @ way), rel=1e-6)


def test_a_stretched_skin_spreads_a_dent() -> None:
    """Under the same depth of a dent the skin beside it follows farther down, and the force is larger."""
    mesh = block((6, 4, 6), size=(60.0, 40.0, 60.0))
    mesh = replace(mesh, fixed=mesh.points[:, 1] < 1e-6)
    top = np.flatnonzero(mesh.points[:, 1] > 39.9)
    middle = top[np.linalg.norm(mesh.points[top][:, [0, 2]] - 30.0, axis=1) < 1.0]
    beside = top[np.abs(np.linalg.norm(mesh.points[top][:, [0, 2]] - 30.0, axis=1) - 10.0) < 1.0]
    found = []
    for membrane in (None, Membrane(tension=0.05), Membrane(shear=0.5, tension=0.05)):
        system = ElasticSystem(mesh, [TISSUE], membrane=membrane)
        solved = solve_imposed(
            system, [(middle, np.tile([0.0, -4.0, 0.0], (len(middle), 1)))],
            config=SolverConfig(tolerance=1e-8), linear=SuperLUSolver(),
        )
        assert solved.converged.all()
        field = solved.displacement[0]
        state = system.place(mesh.points + field, system.rest_state().rotation, system.rest_state().translation)
        found.append((field[beside, 1].mean(), -system.gradient(state)[middle, 1].sum()))
    assert found[0][0] > found[1][0] > found[2][0]
    assert found[0][1] < found[1][1] < found[2][1]


def test_a_record_keeps_it_and_bad_figures_are_refused() -> None:
    tied = Restraints(membrane=BOTH)
    assert Restraints.of_record(tied.record(), "here") == tied
    assert Restraints().record() == {}
    with pytest.raises(InputError, match="shear"):
        Membrane(shear=-1.0)
    with pytest.raises(InputError, match="here"):
        Restraints.of_record({"membrane": {"kind": "Membrane", "shear": "a"}}, "here")
