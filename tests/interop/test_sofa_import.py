import numpy as np
import pytest

from mixpinn.base.errors import InputError
from mixpinn.dataset import (
    SOFA_REPLAY,
    SimulationStore,
    dataset_table,
    list_poses,
    probe_path,
    read_positions,
    split_sofa_subset,
    table_of,
)
from mixpinn.interop import import_sofa, read_sofa_recording, read_sofa_static
from mixpinn.mesh import import_vtu
from mixpinn.records import TissueMesh

SMALL = TissueMesh(
    np.array([[0, 0, 0], [10, 0, 0], [0, 10, 0], [0, 0, 10.0]]), np.array([[0, 1, 2, 3]], dtype=np.int32),
    np.array([0, 0, 0, 0], dtype=np.int16), np.zeros(4, dtype=bool), (), np.zeros(1, dtype=np.int16),
)


def recording(**changes):
    values = {
        "displacement_um": np.zeros((2, 4, 3), dtype=np.int16), "contact_offsets": np.array([0, 0, 2], dtype=np.int32),
        "contact_nodes": np.array([2, 3], dtype=np.int32),
        "contact_forces_mN": np.array([[0, -2000, 0], [0, 0, 0]], dtype=np.float32),
        "contact_probe_position": np.array([[0, 12, 0], [0, 11, 0]], dtype=np.float32),
        "rotation_deg": np.float32(45.0), "position_index": np.int32(3),
    }
    values["displacement_um"][1, 2] = [1000, -1500, 0]
    return {key: value for key, value in (values | changes).items() if value is not None}


@pytest.fixture(scope="module")
def patient(shared_data):
    folder = shared_data / "patient1/paper"
    return import_vtu(folder / "body.vtu", fixed=folder / "fixed.txt")


def test_units_contacts_and_wrench_by_hand(tmp_path):
    np.savez(tmp_path / "pose_003_045.npz", **recording())
    simulation = read_sofa_recording(tmp_path / "pose_003_045.npz", SMALL)
    assert (simulation.position_index, simulation.rotation_deg) == (3, 45.0)
    assert simulation.path.depths.tolist() == [-7.0, -6.0]
    np.testing.assert_allclose(simulation.displacement[1, 2], [1.0, -1.5, 0.0])
    assert simulation.sample_steps().tolist() == [1]
    nodes, forces = simulation.contacts(1)
    assert nodes.tolist() == [2]
    np.testing.assert_allclose(forces, [[0.0, -2.0, 0.0]])
    # Node 2 at (1, 8.5, 0), tip at (0, 11, 0): arm (1, −2.5, 0); reaction (0, 2, 0); moment arm × reaction = (0, 0, 2).
    np.testing.assert_allclose(simulation.probe_wrench, [[0] * 6, [0, 2, 0, 0, 0, 2]], atol=1e-12)
    np.testing.assert_allclose(simulation.path.rotations[0] @ [1, 0, 0], [0.5**0.5, 0, -(0.5**0.5)])


@pytest.mark.parametrize(("changes", "message"), [
    ({"displacement_um": np.zeros((2, 5, 3), dtype=np.int16)}, "4 nodes"),
    ({"contact_nodes": None}, "no contact_nodes"),
    ({"contact_nodes": np.array([2, 4])}, "contact lists"),
    ({"contact_offsets": np.array([0, 2])}, "contact lists"),
    ({"contact_offsets": np.array([0, 3, 2])}, "contact lists"),
])
def test_recordings_that_do_not_fit_are_refused(tmp_path, changes, message):
    np.savez(tmp_path / "pose_003_045.npz", **recording(**changes))
    with pytest.raises(InputError, match=message):
        read_sofa_recording(tmp_path / "pose_003_045.npz", SMALL)


def test_unreadable_or_absent_recordings_are_refused(tmp_path):
    (tmp_path / "pose_000_000.npz").write_bytes(b"PK\x03\x04 truncated")
    with pytest.raises(InputError, match="readable"):
        read_sofa_recording(tmp_path / "pose_000_000.npz", SMALL)
    with pytest.raises(InputError, match="no such file"):
        list(import_sofa(tmp_path, SMALL, names=["pose_001_000"]))
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="none"):
        list(import_sofa(tmp_path / "empty", SMALL))


def test_reference_numbers_of_the_shared_fields(shared_data, patient):
    simulations = list(import_sofa(shared_data / "sofa", patient))
    table = table_of(simulations)
    assert len(simulations) == 74
    assert len(table) == 1366
    assert np.linalg.norm(table.displacement, axis=2).mean() == pytest.approx(1.562, abs=5e-4)
    counts = dataset_table(table, split_sofa_subset(table.position_index))
    assert counts.positions == (53, 0, 13, 66)
    assert counts.poses[3] == 74
    listed = table_of(simulations[:4], contact="listed")
    loaded = table_of(simulations[:4])
    assert len(listed) == len(loaded)
    assert (np.diff(listed.contact_offsets) >= np.diff(loaded.contact_offsets)).all()


def test_rigid_parts_of_the_recordings_move_rigidly(shared_data, patient):
    simulation = read_sofa_recording(shared_data / "sofa/pose_000_000.npz", patient)
    for k in range(1, 6):
        nodes = patient.part_nodes(k)
        rest = patient.points[nodes]
        rotation, shift = simulation.part_rotation[-1, k - 1], simulation.part_translation[-1, k - 1]
        moved = (rest - rest.mean(axis=0)) @ rotation.T + rest.mean(axis=0) + shift
        np.testing.assert_allclose(moved, rest + simulation.displacement[-1, nodes], atol=2e-3)
    assert simulation.probe_wrench[-1, 1] > 10.0
    assert 0.5 < simulation.seconds.mean() < 5.0


def test_path_is_that_of_the_replay_protocol(shared_data, patient):
    positions = read_positions(shared_data / "patient1/paper/probe_positions.txt")
    simulation = read_sofa_recording(shared_data / "sofa/pose_035_090.npz", patient)
    path = probe_path(positions[35], 90.0, SOFA_REPLAY)
    np.testing.assert_allclose(simulation.path.translations, path.translations, atol=1e-4)
    np.testing.assert_allclose(simulation.path.rotations, path.rotations, atol=1e-6)
    np.testing.assert_array_equal(simulation.path.depths, path.depths)


def test_static_fields(shared_data, patient):
    positions = read_positions(shared_data / "patient1/paper/probe_positions.txt")
    static = read_sofa_static(shared_data / "sofa/static/pose_000_000.npz", patient, positions)
    moving = read_sofa_recording(shared_data / "sofa/pose_000_000.npz", patient)
    assert static.path.depths.tolist() == [20.0]
    np.testing.assert_allclose(static.path.translations[0], moving.path.translations[-1], atol=1e-4)
    difference = np.linalg.norm(static.displacement[0] - moving.displacement[-1], axis=1)
    assert difference.mean() < 0.03
    assert len(static.contacts(0)[0])


def test_recordings_fill_a_store(shared_data, patient, tmp_path):
    positions = read_positions(shared_data / "patient1/paper/probe_positions.txt")
    store = SimulationStore.create(
        tmp_path, patient, protocol=SOFA_REPLAY, positions=positions, poses=list_poses(positions, SOFA_REPLAY),
    )
    simulation = read_sofa_recording(shared_data / "sofa/pose_000_045.npz", patient)
    pose = next(pose for pose in store.poses if pose.name == "pose_000_045")
    status = store.save(pose, simulation)
    assert status.contact_steps == len(simulation.sample_steps()) > 15
    assert status.worst_residual is None
    np.testing.assert_array_equal(store.load(pose).displacement, simulation.displacement)
