"""The prediction stage: from a file or a store's sample to a mesh that other programs open."""

from pathlib import Path

import numpy as np
import pytest
import pyvista as pv

from mixpinn.base.errors import InputError
from mixpinn.dataset import Pose, Protocol, SimulationStore
from mixpinn.records import ProbePath, SampleTable, Simulation, TissueMesh
from mixpinn.serving import Predictor, SampleAddress
from mixpinn.stages.prediction import answer_contacts


@pytest.fixture
def contacts(tmp_path: Path, table: SampleTable) -> Path:
    """The first sample's contacts as a file."""
    sample = table[0]
    path = tmp_path / "contacts.npz"
    np.savez(path, nodes=sample.contact_nodes, displacements=sample.contact_displacement)
    return path


@pytest.fixture
def store(tmp_path: Path, mesh: TissueMesh, table: SampleTable) -> Path:
    """A store with one pose whose steps are the samples, at depths 1 to 4 mm."""
    n = len(table)
    turns = np.tile(np.eye(3), (n, 1, 1))
    pose = Pose(0, (20.0, 40.0, 20.0), 45.0)
    simulation = Simulation(
        mesh.hash(), 0, 45.0, ProbePath(np.zeros((n, 3)), turns, np.arange(1.0, n + 1)), table.displacement,
        table.contact_offsets, table.contact_nodes, table.contact_forces, table.probe_wrench,
        np.tile(np.eye(3), (n, 2, 1, 1)), np.zeros((n, 2, 3)), np.ones(n, dtype=bool), np.zeros(n),
        np.ones(n, dtype=np.int64), np.zeros(n), np.ones(n), np.zeros(n), np.ones(n),
    )
    opened = SimulationStore.create(
        tmp_path / "store", mesh, protocol=Protocol(), positions=np.array([pose.position]), poses=(pose,),
    )
    opened.save(pose, simulation)
    return tmp_path / "store"


def test_the_deformed_mesh_is_written(folder: Path, contacts: Path, tmp_path: Path, mesh: TissueMesh) -> None:
    out = tmp_path / "deformed.vtu"
    answer = answer_contacts(Predictor.load(folder, threads=1), contacts)
    answer.save(out)
    grid = pv.read(out)
    np.testing.assert_allclose(grid.points, mesh.points + answer.displacement, atol=1e-6)
    np.testing.assert_array_equal(grid.point_data["displacement"], answer.displacement)
    np.testing.assert_array_equal(grid.point_data["part"], mesh.part)
    answer.save(tmp_path / "deformed.stl")
    surface = pv.read(tmp_path / "deformed.stl")
    assert surface.n_cells == len(mesh.boundary_faces)
    np.testing.assert_allclose(surface.bounds, grid.bounds, atol=1e-3)


def test_a_sample_of_a_store_is_predicted_beside_its_reference(
    folder: Path, store: Path, tmp_path: Path, table: SampleTable,
) -> None:
    out = tmp_path / "deformed.vtu"
    predictor = Predictor.load(folder)
    answer_contacts(predictor, SampleAddress(store, 0, 45.0, depth=2.0)).save(out)
    grid = pv.read(out)
    reference = table.displacement[1]
    predicted = predictor.predict(*table.contact(1))
    np.testing.assert_allclose(grid.point_data["error"], np.linalg.norm(predicted - reference, axis=1), atol=1e-5)
    deepest = answer_contacts(predictor, SampleAddress(store, 0, 45.0))
    np.testing.assert_array_equal(deepest.reference, table.displacement[3])


@pytest.mark.parametrize(("address", "message"), [
    ((9, 45.0, 2.0), "position 9 at 45°"), ((0, 90.0, 2.0), "position 0 at 90°"), ((0, 45.0, 7.5), "7.5 mm"),
])
def test_unknown_samples_are_refused(
    folder: Path, store: Path, address: tuple[int, float, float], message: str,
) -> None:
    with pytest.raises(InputError, match=message):
        answer_contacts(Predictor.load(folder), SampleAddress(store, *address))


def test_unknown_suffixes_leave_nothing_behind(folder: Path, contacts: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"\.vtu, \.stl or \.ply"):
        answer_contacts(Predictor.load(folder), contacts).save(tmp_path / "deformed.obj")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["contacts.npz"]
