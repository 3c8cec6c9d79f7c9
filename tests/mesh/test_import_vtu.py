import numpy as np
import pytest
import pyvista as pv

from mixpinn.base.errors import InputError
from mixpinn.mesh import fixed_nodes, import_vtu, load_paper_mesh, mesh_statistics

from .shapes import box_mesh

CAVITY = np.s_[1:3, 1:3, 1:2]


@pytest.fixture
def grid():
    return box_mesh(cavity=CAVITY).grid()


def save(grid, folder):
    grid.save(folder / "mesh.vtu")
    return folder / "mesh.vtu"


def test_negative_cells_are_turned_and_labels_read(grid, tmp_path):
    mesh = box_mesh(cavity=CAVITY)
    turned = mesh.cells.copy()
    turned[::3] = turned[::3][:, [1, 0, 2, 3]]
    cells = np.column_stack([np.full(len(turned), 4), turned])
    other = pv.UnstructuredGrid(cells, np.full(len(turned), pv.CellType.TETRA), mesh.points)
    other.point_data["rigid"] = mesh.part
    got = import_vtu(save(other, tmp_path), rigid_names=["block"])
    assert (got.cell_volumes > 0).all()
    np.testing.assert_array_equal(got.part, mesh.part)
    np.testing.assert_array_equal(got.fixed, fixed_nodes(got))
    assert got.rigid_names == ("block",)


def test_own_files_round_trip(grid, tmp_path):
    mesh = import_vtu(save(grid, tmp_path))
    assert mesh.rigid_names == ("block",)
    assert not mesh.fixed.any()


def test_fixed_file_counts_within_the_soft_nodes(grid, tmp_path):
    soft = np.flatnonzero(grid.point_data["part"] == 0)
    index = np.full(grid.n_points, -1)
    index[soft] = np.arange(len(soft))[::-1]
    grid.point_data["deformable_id"] = index
    (tmp_path / "fixed.txt").write_text("0\n2\n")
    mesh = import_vtu(save(grid, tmp_path), fixed=tmp_path / "fixed.txt")
    assert set(np.flatnonzero(mesh.fixed)) == {soft[-1], soft[-3]}


@pytest.mark.parametrize(("text", "message"), [("0\n99999\n", "99999"), ("0 one", "one integer a line")])
def test_bad_fixed_file(grid, tmp_path, text, message):
    (tmp_path / "fixed.txt").write_text(text)
    with pytest.raises(InputError, match=message):
        import_vtu(save(grid, tmp_path), fixed=tmp_path / "fixed.txt")


def test_unknown_part_labels(grid, tmp_path):
    grid.point_data["part"][0] = 7
    with pytest.raises(InputError, match="unknown part labels"):
        import_vtu(save(grid, tmp_path))


def test_part_without_nodes(grid, tmp_path):
    with pytest.raises(InputError, match="no node with part label"):
        import_vtu(save(grid, tmp_path), rigid_names=["block", "ghost"])


def test_negative_part_labels(grid, tmp_path):
    grid.point_data["part"][0] = -1
    with pytest.raises(InputError, match="negative or fractional"):
        import_vtu(save(grid, tmp_path))


def test_other_cells(tmp_path):
    hexahedra = pv.ImageData(dimensions=(3, 3, 3)).cast_to_unstructured_grid()
    with pytest.raises(InputError, match="voxel"):
        import_vtu(save(hexahedra, tmp_path))


def test_damaged_and_absent_files(grid, tmp_path):
    path = save(grid, tmp_path)
    path.write_bytes(path.read_bytes()[: 900])
    with pytest.raises(InputError):
        import_vtu(path)
    with pytest.raises(InputError, match="no such file"):
        import_vtu(tmp_path / "absent.vtu")


def test_paper_mesh_has_the_papers_table(shared_data):
    mesh = load_paper_mesh(shared_data / "patient1" / "paper")
    table = mesh_statistics(mesh)
    assert [part.points for part in table.parts] == [5533, 516, 676, 655, 702, 664]
    assert [part.edges for part in table.parts] == [74896, 3372, 4634, 4350, 4766, 4680]
    assert (table.points, table.edges, table.fixed) == (8746, 96698, 215)


def test_protocol_rule_finds_the_papers_fixed_nodes(shared_data):
    mesh = load_paper_mesh(shared_data / "patient1" / "paper")
    np.testing.assert_array_equal(fixed_nodes(mesh), mesh.fixed)
