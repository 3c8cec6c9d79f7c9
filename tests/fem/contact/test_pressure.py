from dataclasses import replace

import numpy as np
import pytest

from fem.block_mesh import block, labelled
from mixpinn.base.errors import InputError
from mixpinn.fem import ContactConfig, LinearElastic, Scene, contact_area, contact_pressure, simulate_pose
from mixpinn.fem.elements.jacobians import smallest_jacobians
from mixpinn.records import Probe, ProbePath

MESH = block((3, 2, 3), size=(30.0, 10.0, 30.0))
MESH = labelled(MESH.points, MESH.cells, fixed=MESH.points[:, 1] == 0.0)
PLATE = Probe(
    np.array([[-50.0, 0.0, -50.0], [50.0, 0.0, -50.0], [50.0, 0.0, 50.0], [-50.0, 0.0, 50.0]]),
    np.array([[0, 1, 2], [0, 2, 3]]), "plate",
)
YOUNG = 0.02


@pytest.fixture(scope="module")
def simulation():
    scene = Scene(MESH, PLATE, (LinearElastic.from_young(YOUNG, 0.0),), ContactConfig(friction=0.0, spacing=20.0))
    places = np.array([[15.0, 12.1, 15.0], [15.0, 11.8, 15.0], [15.0, 11.6, 15.0]])
    path = ProbePath(places, np.tile(np.eye(3), (3, 1, 1)), np.arange(3.0))
    return simulate_pose(scene, path, position_index=0, rotation_deg=0.0)


def test_flat_plate_on_a_flat_block(simulation):
    found = contact_pressure(MESH, simulation, 2)
    assert len(found.nodes) == 16  # all of the upper face
    assert found.area.sum() == pytest.approx(900.0, rel=1e-3)
    strain = -simulation.displacement[2][found.nodes, 1].mean() / 10.0
    assert found.mean_pressure == pytest.approx(YOUNG * strain, rel=1e-3)
    np.testing.assert_allclose(found.pressure, YOUNG * strain, rtol=0.01)  # at the rim, too


def test_force_is_the_probes_and_nothing_without_contact(simulation):
    found = contact_pressure(MESH, simulation, 2)
    assert found.force.sum() == pytest.approx(simulation.probe_wrench[2, 1], rel=1e-9)
    before = contact_pressure(MESH, simulation, 0)
    assert (before.mean_pressure, len(before.nodes)) == (0.0, 0)
    assert contact_area(MESH, PLATE, simulation, 0) == 0.0


def test_area_is_seen_along_the_direction(simulation):
    slanted = np.array([0.6, -0.8, 0.0])
    found = contact_pressure(MESH, simulation, 2, direction=slanted)
    # The upper face of 900 mm² and, at its left rim, what belongs to it of the side that faces the probe.
    side = found.area.sum() - 0.8 * 900.0
    assert 0.0 < side < 0.6 * 300.0
    # From below only the sides are seen, which lean by what the penalty gives way.
    assert contact_pressure(MESH, simulation, 2, direction=np.array([0.0, 1.0, 0.0])).area.sum() < 0.1


def test_area_of_a_smaller_plate_on_a_coarse_skin(simulation):
    # The skin is pressed flat; of a square of 17 mm in place of the plate it touches what lies within the gap, which
    # is the square itself, widened by less than the distance √(2² − d²) at d just below the gap of 2 mm.
    half = 8.5
    corners = np.array([[-half, 0.0, -half], [half, 0.0, -half], [half, 0.0, half], [-half, 0.0, half]])
    area = contact_area(MESH, Probe(corners, PLATE.triangles, "square"), simulation, 2, slack=0.0, spacing=0.25)
    assert 17.0**2 - 17.0 <= area <= 17.5**2
    assert contact_area(MESH, PLATE, simulation, 2) == pytest.approx(900.0, rel=0.02)


def test_refuses_another_mesh_and_another_step(simulation):
    with pytest.raises(InputError, match="another mesh"):
        contact_pressure(replace(MESH, points=MESH.points + 1.0), simulation, 2)
    with pytest.raises(InputError, match="from 0 to 2"):
        contact_pressure(MESH, simulation, 3)


def test_quadratic_faces_under_a_plate_carry_one_pressure():
    """Patch test of contact: ν = 0 and no friction, so that strain and pressure are uniform."""
    mesh = MESH.with_order(2)
    scene = Scene(mesh, PLATE, (LinearElastic.from_young(YOUNG, 0.0),), ContactConfig(friction=0.0))
    places = np.array([[15.0, 12.1, 15.0], [15.0, 11.8, 15.0], [15.0, 11.6, 15.0]])
    found = simulate_pose(
        scene, ProbePath(places, np.tile(np.eye(3), (3, 1, 1)), np.arange(3.0)), position_index=0, rotation_deg=0.0,
    )
    top = mesh.node_points[:, 1] > 10.0 - 1e-9
    moved = found.displacement[2][top, 1].astype(np.float64)
    np.testing.assert_allclose(moved, moved.mean(), atol=1e-6)
    nodes, forces = found.contacts(2)
    assert set(nodes) == set(np.flatnonzero(top))  # vertices too, though the pressure leaves them without force
    pressure = contact_pressure(mesh, found, 2)
    assert len(pressure.nodes) == 16
    np.testing.assert_allclose(pressure.pressure, -YOUNG * moved.mean() / 10.0, rtol=1e-4)
    inside = np.isin(nodes, np.flatnonzero(top & (np.abs(mesh.node_points[:, [0, 2]] - 15.0) < 10.0).all(axis=1)))
    vertex = inside & (nodes < mesh.n_points)
    assert np.abs(forces[vertex, 1]).max() < 1e-6 * np.abs(forces[:, 1]).max()
    assert contact_area(mesh, PLATE, found, 2) == pytest.approx(900.0, rel=0.02)
    np.testing.assert_allclose(smallest_jacobians(mesh, found.displacement[2]), 1.0 + moved.mean() / 10.0, atol=1e-5)
