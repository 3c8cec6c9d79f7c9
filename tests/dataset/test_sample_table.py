import numpy as np
import pytest

from dataset.dataset_fakes import FakeScene, block, fake_runner, fake_simulation, filled_store, short_store
from mixpinn.base.errors import InputError
from mixpinn.dataset import build_sample_table, run_pose, table_of


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    return filled_store(tmp_path_factory.mktemp("store"), FakeScene(block(3), trouble={1: "unconverged"}))


def test_samples_are_the_converged_loaded_steps(store):
    table = build_sample_table(store)
    # 3 positions × 2 rotations, depths −1 … 4: steps 1 … 4 carry load; the last two of position 1 did not converge.
    assert len(table) == 4 * 4 + 2 * 2
    assert table.depth[:4].tolist() == [1.0, 2.0, 3.0, 4.0]
    assert table.depth[table.position_index == 1].tolist() == [1.0, 2.0, 1.0, 2.0]
    assert table.rotation_deg[4:8].tolist() == [90.0] * 4
    np.testing.assert_allclose(table.probe_translation[:4, 1], -table.depth[:4])
    np.testing.assert_allclose(table.probe_wrench[:, 1], table.depth)
    assert table.mesh_hash == store.mesh_hash


def test_offsets_and_contact_rules(store):
    loaded, listed = build_sample_table(store), build_sample_table(store, contact="listed")
    assert loaded.contact_offsets.tolist() == list(range(len(loaded) + 1))
    assert listed.contact_offsets.tolist() == list(range(0, 2 * len(listed) + 1, 2))
    for i in range(len(loaded)):
        assert set(loaded.contacts(i)) < set(listed.contacts(i))
        np.testing.assert_allclose(loaded.contact_forces[loaded.contact_offsets[i], 1], -loaded.depth[i])
    sample = loaded[2]
    np.testing.assert_allclose(sample.contact_displacement[0, 1], -3.0)
    np.testing.assert_array_equal(loaded.displacement, listed.displacement)


def test_memory_map_equals_memory(store, tmp_path):
    table = build_sample_table(store)
    mapped = build_sample_table(store, memory_map=tmp_path / "fields.npy")
    assert isinstance(mapped.displacement, np.memmap)
    assert mapped.displacement.dtype == np.float32
    np.testing.assert_array_equal(mapped.displacement, table.displacement)
    np.testing.assert_array_equal(mapped.select(np.arange(3)).displacement, table.displacement[:3])
    with pytest.raises(InputError, match=r"\.npy file"):
        build_sample_table(store, memory_map=tmp_path / "fields.dat")


def test_table_of_simulations_equals_table_of_store(store):
    direct, stored = table_of(store), build_sample_table(store)
    for name in ("depth", "contact_nodes", "contact_offsets", "displacement", "probe_wrench"):
        np.testing.assert_array_equal(getattr(direct, name), getattr(stored, name))


def test_nothing_to_sample_is_refused(tmp_path):
    scene = FakeScene(block(3))
    store = short_store(tmp_path, scene)
    with pytest.raises(InputError, match="at least one sample"):
        build_sample_table(store)
    run_pose(store, FakeScene(block(3), trouble={0: "raise"}), fake_runner, store.poses[0])
    with pytest.raises(InputError, match="at least one sample"):
        build_sample_table(store)


def test_simulations_of_several_meshes_are_refused(store):
    from mixpinn.dataset import probe_path

    path = probe_path((0.0, 0.0, 0.0), 0.0, store.protocol)
    several = [fake_simulation(block(n), path, position_index=0, rotation_deg=0.0) for n in (3, 4)]
    with pytest.raises(InputError, match="2 meshes"):
        table_of(several)


def test_samples_of_quadratic_cells_have_all_nodes(tmp_path):
    mesh = block(3).with_order(2)
    store = filled_store(tmp_path, FakeScene(mesh))
    assert store.mesh().order == 2
    assert store.mesh_hash == mesh.hash() != block(3).hash()
    whole, table = store.load(store.poses[0]), build_sample_table(store, contact="listed")
    assert whole.displacement.shape[1] == mesh.n_nodes
    steps = whole.sample_steps()
    np.testing.assert_array_equal(table.displacement[: len(steps)], whole.displacement[steps])
    seen = table.on_vertices(mesh.n_points)
    np.testing.assert_array_equal(seen.displacement, table.displacement[:, : mesh.n_points])
    assert (seen.contact_nodes < mesh.n_points).all()
    # A store of linear cells on the same vertices is another one: their tables may not be mixed.
    linear = FakeScene(block(3))
    path = whole.path
    several = [fake_simulation(one, path, position_index=0, rotation_deg=0.0) for one in (mesh, linear.mesh)]
    with pytest.raises(InputError, match="one mesh"):
        table_of(several)
