import json
from dataclasses import replace

import numpy as np
import pytest

from dataset.dataset_fakes import SHORT, FakeScene, block, fake_simulation, filled_store, short_store
from mixpinn.base.errors import InputError
from mixpinn.dataset import PoseState, SimulationStore, build_sample_table, list_poses, probe_path
from mixpinn.dataset.store import STORE
from mixpinn.records import SampleTable
from mixpinn.records.answer import discretisation_of


@pytest.fixture
def scene():
    return FakeScene(block(3))


def simulation_of(store, scene, pose):
    path = probe_path(pose.position, pose.rotation_deg, store.protocol)
    return fake_simulation(scene.mesh, path, position_index=pose.position_index, rotation_deg=pose.rotation_deg)


def test_what_is_saved_is_loaded(tmp_path, scene):
    store = short_store(tmp_path, scene)
    pose = store.poses[3]
    saved = simulation_of(store, scene, pose)
    status = store.save(pose, saved)
    assert status.contact_steps == 4  # depths −1 … 4: four of them positive
    loaded = SimulationStore.open(tmp_path).load(pose)
    for name, array in saved.arrays().items():
        np.testing.assert_array_equal(loaded.arrays()[name], array)


def test_open_restores_all_settings(tmp_path, scene):
    store = short_store(tmp_path, scene)
    again = SimulationStore.open(tmp_path, mesh=scene.mesh)
    assert (again.poses, again.protocol, again.scene) == (store.poses, store.protocol, store.scene)
    assert again.scene_hash == store.scene_hash
    assert again.identity == store.identity
    assert again.mesh().hash() == scene.mesh.hash()
    assert [status.state for status in again.statuses()] == [PoseState.MISSING] * 6


def test_create_goes_on_with_its_own_store_only(tmp_path, scene):
    short_store(tmp_path, scene)
    assert short_store(tmp_path, scene).poses
    with pytest.raises(InputError, match="protocol"):
        short_store(tmp_path, scene, protocol=replace(SHORT, steps=7))
    with pytest.raises(InputError, match=r"mesh_hash.*linear tetrahedra, 27 nodes.* instead of linear tetrahedra, 64"):
        short_store(tmp_path, FakeScene(block(4)))


@pytest.mark.parametrize("absent", [("manifest.json",), ("manifest.json", "mesh.vtu")])
def test_a_store_that_was_being_begun_is_begun_again(tmp_path, scene, absent):
    short_store(tmp_path, scene)
    for name in absent:
        (tmp_path / name).unlink()
    short_store(tmp_path, scene)
    assert SimulationStore.open(tmp_path).mesh().hash() == scene.mesh.hash()


def test_a_record_that_is_no_record_is_one_line(tmp_path, scene):
    short_store(tmp_path, scene)
    (tmp_path / "store.json").write_text("[]")
    with pytest.raises(InputError, match=r"a store with other .*mesh_hash"):
        short_store(tmp_path, scene)


def test_a_store_and_its_table_name_their_discretisation(tmp_path, scene):
    store = filled_store(tmp_path, scene)
    assert json.loads((tmp_path / "store.json").read_text())["discretisation"] == discretisation_of(scene.mesh)
    assert SimulationStore.open(tmp_path).discretisation == discretisation_of(scene.mesh)
    table = build_sample_table(store)
    table.save(tmp_path / "samples")
    loaded = SampleTable.load(tmp_path / "samples").select(np.array([0]))
    assert loaded.made_on == table.made_on == discretisation_of(scene.mesh)


def test_the_record_of_an_older_version_names_its_mesh(tmp_path, scene):
    store = short_store(tmp_path, scene)
    record = json.loads((tmp_path / "store.json").read_text())
    del record["discretisation"]
    (tmp_path / "store.json").write_text(json.dumps(record))
    STORE.seal(tmp_path, ["store.json", "mesh.vtu"])
    again = SimulationStore.open(tmp_path)
    assert again.discretisation == f"mesh {scene.mesh.hash()}"
    assert again.identity == store.identity


def test_store_of_another_mesh_is_refused(tmp_path, scene):
    store = short_store(tmp_path, scene)
    with pytest.raises(InputError, match=r"simulations of linear tetrahedra, 64 nodes.*those of linear tetrahedra, 27"):
        SimulationStore.open(tmp_path, mesh=block(4))
    pose = store.poses[0]
    with pytest.raises(InputError, match="on the mesh"):
        store.save(pose, replace(simulation_of(store, scene, pose), mesh_hash="another"))
    with pytest.raises(InputError, match="pose_000_000"):
        store.save(pose, simulation_of(store, scene, store.poses[1]))


def test_exchanged_mesh_is_found_out(tmp_path, scene):
    store = short_store(tmp_path, scene)
    block(4).save(tmp_path / "mesh.vtu")
    with pytest.raises(InputError, match="altered after it was made"):
        store.mesh()
    STORE.seal(tmp_path, ["store.json", "mesh.vtu"])
    with pytest.raises(InputError, match="put the mesh"):
        store.mesh()


def test_absent_or_damaged_record_is_refused(tmp_path, scene):
    with pytest.raises(InputError, match="run 'mixpinn simulate' first"):
        SimulationStore.open(tmp_path)
    short_store(tmp_path, scene)
    record = json.loads((tmp_path / "store.json").read_text())
    del record["poses"]
    (tmp_path / "store.json").write_text(json.dumps(record))
    with pytest.raises(InputError, match="altered after it was made"):
        SimulationStore.open(tmp_path)
    STORE.seal(tmp_path, ["store.json", "mesh.vtu"])
    with pytest.raises(InputError, match=r"store\.json: poses"):
        SimulationStore.open(tmp_path)


def delete_a_chunk(folder):
    next(path for path in sorted(folder.glob("displacement/c/**/*")) if path.is_file()).unlink()


def truncate_a_chunk(folder):
    path = max((path for path in folder.rglob("*") if path.is_file()), key=lambda path: path.stat().st_size)
    path.write_bytes(path.read_bytes()[:-10])


@pytest.mark.parametrize("damage", [delete_a_chunk, truncate_a_chunk])
def test_truncated_group_counts_as_missing_and_is_not_read(tmp_path, scene, damage):
    store = filled_store(tmp_path, scene)
    damage(store.pose_folder(store.poses[2]))
    assert store.status(store.poses[2]).state is PoseState.MISSING
    assert "damaged" in store.status(store.poses[2]).reason
    with pytest.raises(InputError, match="damaged"):
        store.load(store.poses[2])
    with pytest.raises(InputError, match="damaged"):
        build_sample_table(store)


def test_altered_bytes_are_found_out(tmp_path, scene):
    store = filled_store(tmp_path, scene)
    chunk = store.pose_folder(store.poses[0]) / "probe_wrench"
    path = next(item for item in chunk.rglob("*") if item.is_file() and item.name != "zarr.json")
    content = bytearray(path.read_bytes())
    content[-1] ^= 0xFF
    path.write_bytes(bytes(content))
    with pytest.raises(InputError, match="pose_000_000"):
        store.load(store.poses[0])


def test_group_without_status_is_not_done(tmp_path, scene):
    store = filled_store(tmp_path, scene)
    (tmp_path / "status" / "pose_000_000.json").unlink()
    assert store.status(store.poses[0]).state is PoseState.MISSING
    (tmp_path / "status" / "pose_000_090.json").write_text('{"state": "do')
    assert store.status(store.poses[1]).state is PoseState.MISSING


def test_failure_replaces_data_and_is_skipped_in_reading(tmp_path, scene):
    store = filled_store(tmp_path, scene)
    store.fail(store.poses[0], "no equilibrium", attempts=2)
    assert store.status(store.poses[0]).reason == "no equilibrium"
    assert not store.pose_folder(store.poses[0]).exists()
    assert len(list(store)) == 5
    with pytest.raises(InputError, match="no equilibrium"):
        store.load(store.poses[0])


def test_poses_of_one_name_are_refused(tmp_path, scene):
    poses = list_poses(np.zeros((1, 3)), SHORT)
    with pytest.raises(InputError, match="two of one name"):
        SimulationStore.create(tmp_path, scene.mesh, protocol=SHORT, positions=np.zeros((1, 3)), poses=poses * 2)


def test_what_file_managers_leave_is_no_damage(tmp_path, scene):
    store = filled_store(tmp_path, scene)
    before = build_sample_table(store)
    for pose in store.poses:
        folder = store.pose_folder(pose)
        (folder / ".DS_Store").write_bytes(b"Bud1")
        (folder / "Thumbs.db").write_bytes(b"x")
        for path in [path for path in folder.rglob("*") if path.is_file() and path.name[0] not in ".T"]:
            (path.parent / f"._{path.name}").write_bytes(b"x")
    assert {status.state for status in SimulationStore.open(tmp_path).statuses()} == {PoseState.DONE}
    after = build_sample_table(SimulationStore.open(tmp_path))
    np.testing.assert_array_equal(after.displacement, before.displacement)
