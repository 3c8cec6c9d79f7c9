"""Foundations: derivatives, the linear limits, lifting off, areas."""

from dataclasses import replace

import numpy as np
import pytest

from fem.block_mesh import block
from mixpinn.base.errors import InputError
from mixpinn.fem import ElasticSystem, LinearElastic
from mixpinn.physics.foundation import Face, Foundation, FoundationSystem
from validation.newton import equilibrium

MESH = block((3, 4, 5), size=(30.0, 40.0, 50.0))
PAD = Foundation(Face.FRONT, 3e-3, shear=1e-3, sink=1.5)
CAPS = Foundation(Face.CAPS, 0.2, shear=0.1)


@pytest.mark.parametrize("order", [1, 2])
def test_forces_and_stiffness_are_derivatives(order) -> None:
    mesh = MESH.with_order(order)
    system, rng = FoundationSystem((PAD, CAPS), mesh), np.random.default_rng(0)
    moved = 1.5 * rng.normal(size=(mesh.n_nodes, 3))
    forces, diagonals = np.zeros_like(moved), np.zeros((mesh.n_nodes, 3, 3))
    system.add_forces(moved, forces)
    system.add_stiffness(moved, diagonals)
    way, h = rng.normal(size=moved.shape), 1e-5
    slope = (system.energy(moved + h * way) - system.energy(moved - h * way)) / (2.0 * h)
    assert slope == pytest.approx(float((forces * way).sum()), rel=1e-7)
    ahead, behind = np.zeros_like(moved), np.zeros_like(moved)
    system.add_forces(moved + h * way, ahead)
    system.add_forces(moved - h * way, behind)
    expected = np.einsum("nij,nj->ni", diagonals, way)
    np.testing.assert_allclose((ahead - behind) / (2.0 * h), expected, atol=1e-5 * np.abs(expected).max())


@pytest.mark.parametrize("order", [1, 2])
def test_areas_add_up_and_rest_is_free_of_force(order) -> None:
    mesh = MESH.with_order(order)
    for foundation, area, axis in ((PAD, 30.0 * 50.0, 1), (CAPS, 2 * 30.0 * 40.0, 2)):
        system, diagonals = FoundationSystem((foundation,), mesh), np.zeros((mesh.n_nodes, 3, 3))
        still, forces = np.zeros((mesh.n_nodes, 3)), np.zeros((mesh.n_nodes, 3))
        system.add_stiffness(still, diagonals)
        system.add_forces(still, forces)
        assert not forces.any()
        assert diagonals[:, axis, axis].sum() == pytest.approx(foundation.stiffness * area)
        assert diagonals[:, 0, 0].sum() == pytest.approx(foundation.shear * area)


def test_skin_that_rises_leaves_the_pad() -> None:
    system = FoundationSystem((PAD,), MESH)
    moved = np.zeros((MESH.n_points, 3))
    sizes = []
    for rise in (-1.0, 0.5, 2.0, 4.0):
        moved[:, 1] = rise
        forces = np.zeros_like(moved)
        system.add_forces(moved, forces)
        sizes.append(forces[:, 1].sum())
    whole = PAD.stiffness * 1500.0
    # pressed in it resists with k; beyond its sink it keeps pulling with no more than the weight it carried
    assert sizes[0] == pytest.approx(-1.0 * whole)
    assert sizes[2] == pytest.approx(sizes[3]) == pytest.approx(whole * (PAD.sink - 0.25 * PAD.sink))
    assert system.lifted(moved) == 1.0


def test_a_column_on_a_pad_under_pressure_is_two_springs_in_a_row() -> None:
    """Uniform pressure p on the back: the pad gives p / k, the column, free to bulge, p h / E."""
    material, pressure = LinearElastic.from_young(0.02, 0.0), 1e-5
    mesh = replace(MESH, fixed=np.zeros(MESH.n_points, dtype=bool))
    pad = Foundation(Face.FRONT, 3e-3, shear=1e-3)
    system = ElasticSystem(mesh, [material], foundations=(pad,))
    back = FoundationSystem((Foundation(Face.FRONT, 1.0),), replace(mesh, points=mesh.points * [1.0, -1.0, 1.0],
                            cells=mesh.cells[:, [1, 0, 2, 3]]))
    shares = np.zeros((mesh.n_points, 3, 3))
    back.add_stiffness(np.zeros_like(mesh.points), shares)
    load = np.zeros_like(mesh.points)
    load[:, 1] = -pressure * shares[:, 1, 1]
    assert -load.sum() == pytest.approx(pressure * 1500.0)
    state = equilibrium(system, system.rest_state(), load=load, tolerance=1e-12).state
    moved = (state.points - mesh.points)[:, 1]
    top, bottom = mesh.points[:, 1] > 39.9, mesh.points[:, 1] < 0.1
    np.testing.assert_allclose(moved[bottom], -pressure / pad.stiffness, rtol=1e-6)
    np.testing.assert_allclose(moved[top], -pressure / pad.stiffness - pressure * 40.0 / 0.02, rtol=1e-6)


def test_settings_without_sense_are_refused() -> None:
    for wrong in ({"stiffness": -1.0}, {"stiffness": 1.0, "sink": 0.0}):
        with pytest.raises(InputError):
            Foundation(Face.FRONT, **wrong)
    with pytest.raises(InputError, match="sink"):
        Foundation(Face.CAPS, 1.0, sink=2.0)
