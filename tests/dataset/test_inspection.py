"""What an inspection of a store finds: turned cells where one was turned, and the steps that failed."""

from dataclasses import replace

import numpy as np
import pytest

from dataset.dataset_fakes import FakeScene, block, short_store
from dataset.test_inverted_cells import turned
from mixpinn.dataset import SimulationStore
from mixpinn.dataset.inspection import QUADRATURE, VERTICES, inspect_store


@pytest.fixture
def mesh():
    return block(4)


def saved(folder, mesh, simulation):
    store = short_store(folder, FakeScene(mesh))
    pose = store.poses[0]
    store.save(pose, replace(simulation, mesh_hash=mesh.hash()))
    return SimulationStore.open(store.folder), pose.name


def test_turned_cells_are_listed_by_pose_step_and_cell(mesh, tmp_path):
    store, pose = saved(tmp_path / "store", mesh, turned(mesh, 17))
    found = inspect_store(store)
    entries = [(entry.at.step, entry.cell) for entry in found.non_positive if entry.cell == 17]
    assert entries == [(4, 17), (5, 17)]
    assert found.smallest.keys() == {QUADRATURE}
    worst = min(found.non_positive, key=lambda entry: entry.determinant)
    assert found.smallest[QUADRATURE] == worst
    assert worst.determinant == pytest.approx(-1.25, abs=1e-5)
    assert (found.done, found.poses, found.steps) == (1, len(store.poses), 6)
    page = found.markdown()
    assert f"| {pose} | 5 | 3 | 17 | quadrature points | -1.25 |" in page
    found.save(tmp_path / "inspection.json")


def test_steps_that_failed_are_listed_and_their_cells_are_not(mesh, tmp_path):
    store, pose = saved(tmp_path / "store", mesh, replace(turned(mesh, 17), converged=np.arange(6) < 4))
    found = inspect_store(store)
    assert [(step.pose, step.step, step.depth) for step in found.unconverged] == [(pose, 4, 2.0), (pose, 5, 3.0)]
    assert found.non_positive == ()
    assert found.smallest[QUADRATURE].determinant == pytest.approx(1.0)
    assert "| Steps that did not converge | 2 |" in found.markdown()


def test_ten_node_cells_are_looked_at_in_their_vertices_too(mesh, tmp_path):
    """A midpoint near a vertex bends the edge: det F falls there first, and on the quadrature points less."""
    quadratic = mesh.with_order(2)
    linear = turned(mesh, 17)
    moved = np.zeros((6, quadratic.n_nodes, 3))
    cell = quadratic.cell_nodes[17]
    first, _, middle = mesh.points[cell[0]], mesh.points[cell[1]], quadratic.node_points[cell[4]]
    moved[3, cell[4]] = 0.9 * (first - middle)
    still = replace(linear, displacement=moved, min_jacobian=np.ones(6))
    store, _ = saved(tmp_path / "store", quadratic, still)
    found = inspect_store(store)
    assert found.smallest[VERTICES].determinant < found.smallest[QUADRATURE].determinant
    assert found.smallest[VERTICES].at.step == 3
    assert {entry.place for entry in found.non_positive} == {VERTICES}


def test_an_empty_store_is_said_to_be_empty(mesh, tmp_path):
    store = short_store(tmp_path / "store", FakeScene(mesh))
    found = inspect_store(store)
    assert (found.done, found.steps, found.smallest[QUADRATURE]) == (0, 0, None)
    assert "unknown" in found.markdown()
