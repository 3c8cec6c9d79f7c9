import numpy as np
import pytest

from mixpinn.base.errors import InputError
from mixpinn.records import SampleTable
from mixpinn.stages.seal import seal_folder


@pytest.fixture
def table():
    """Three samples on a mesh of four nodes, with none, one and two contact nodes."""
    generator = np.random.default_rng(1)
    return SampleTable(
        "mesh", np.arange(3), np.array([0.0, 45.0, 90.0]), np.array([1.0, 2.0, 3.0]), np.zeros((3, 3)),
        np.tile(np.eye(3), (3, 1, 1)), np.array([0, 0, 1, 3]), np.array([2, 0, 3]), np.ones((3, 3)), np.zeros((3, 6)),
        generator.normal(size=(3, 4, 3)).astype(np.float32),
    )


def test_what_is_saved_is_read_again(table, tmp_path):
    table.save(tmp_path / "samples")
    read = SampleTable.load(tmp_path / "samples")
    assert (read.mesh_hash, len(read), read.contact_error) == ("mesh", 3, None)
    for index in range(3):
        np.testing.assert_array_equal(read.contact_field(index), table.contact_field(index))
        np.testing.assert_array_equal(read[index].displacement, table[index].displacement)


def test_contact_error_is_added_to_the_contact_nodes_alone_and_survives_saving(table, tmp_path):
    error = np.array([[0.5, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -2.0]])
    noisy = SampleTable(**{**vars(table), "contact_error": error})
    noisy.save(tmp_path / "samples")
    for given in (noisy, SampleTable.load(tmp_path / "samples")):
        expected = np.zeros((4, 3))
        expected[0], expected[3] = error[1], error[2]
        np.testing.assert_allclose(given.contact_field(2) - table.contact_field(2), expected, atol=1e-6)
        np.testing.assert_allclose(
            given[2].contact_displacement - table[2].contact_displacement, error[1:], atol=1e-6,
        )
        np.testing.assert_array_equal(given[2].displacement, table[2].displacement)


def seal(folder):
    """Vouch for what lies in a table's folder."""
    (folder / "manifest.json").unlink()
    seal_folder(folder)


def test_damaged_tables_are_refused(table, tmp_path):
    table.save(tmp_path / "samples")
    (tmp_path / "samples" / "depth.npy").write_bytes(b"nothing")
    with pytest.raises(InputError, match=r"depth\.npy: .*altered after it was made"):
        SampleTable.load(tmp_path / "samples")
    seal(tmp_path / "samples")
    with pytest.raises(InputError, match="expected a readable array, got something else") as caught:
        SampleTable.load(tmp_path / "samples")
    assert "pickle" not in str(caught.value)
    (tmp_path / "samples" / "depth.npy").unlink()
    seal(tmp_path / "samples")
    with pytest.raises(InputError, match="readable array"):
        SampleTable.load(tmp_path / "samples")


@pytest.mark.parametrize(("name", "value", "says"), [
    ("depth", np.zeros(4), r"shape \(3\)"), ("depth", np.array([0.0, np.nan, 1.0]), "finite"),
    ("contact_nodes", np.array([2, 0, 4]), "nodes below 4, got 4"),
    ("contact_nodes", np.array([2, 0, -1]), "at least 0"),
    ("contact_offsets", np.array([0, 2, 1, 3]), "rise from 0 to 3"),
    ("contact_offsets", np.array([0, 0, 1, 2]), "rise"),
    ("contact_forces", np.ones((2, 3)), r"shape \(3, 3\)"),
    ("displacement", np.zeros((3, 4), dtype=np.float32), "shape"),
])
def test_each_damaged_array_is_one_line(table, tmp_path, name, value, says):
    table.save(tmp_path / "samples")
    np.save(tmp_path / "samples" / f"{name}.npy", value)
    seal(tmp_path / "samples")
    with pytest.raises(InputError, match=says) as caught:
        SampleTable.load(tmp_path / "samples")
    assert name in str(caught.value)
