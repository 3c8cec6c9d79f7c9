from dataclasses import replace

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


def test_own_files_keep_their_place_in_the_scanner_and_their_targets(tmp_path):
    to_scanner = np.array([[0.0, -1.0, 0.0, 5.0], [0.0, 0.0, -1.0, -7.0], [1.0, 0.0, 0.0, 9.0], [0.0, 0.0, 0.0, 1.0]])
    own = replace(box_mesh(cavity=CAVITY), world_to_scanner=to_scanner, targets=("block",))
    own.save(tmp_path / "mesh.vtu")
    mesh = import_vtu(tmp_path / "mesh.vtu")
    np.testing.assert_array_equal(mesh.world_to_scanner, to_scanner)
    assert mesh.targets == ("block",)
    assert import_vtu(tmp_path / "mesh.vtu", rigid_names=["bone"]).targets == ()
    replace(own, world_to_scanner=np.full((4, 4), np.nan)).save(tmp_path / "mesh.vtu")
    with pytest.raises(InputError, match="world_to_scanner: expected finite numbers"):
        import_vtu(tmp_path / "mesh.vtu")


def test_fixed_file_counts_within_the_soft_nodes(grid, tmp_path):
    soft = np.flatnonzero(grid.point_data["part"] == 0)
    index = np.full(grid.n_points, -1)
    index[soft] = np.arange(len(soft))[::-1]
    grid.point_data["deformable_id"] = index
    (tmp_path / "fixed.txt").write_text("0\n2\n")
    mesh = import_vtu(save(grid, tmp_path), fixed=tmp_path / "fixed.txt")
    assert set(np.flatnonzero(mesh.fixed)) == {soft[-1], soft[-3]}


@pytest.mark.parametrize(("text", "message"), [
    ("0\n99999\n", "99999"), ("0 one", "got 'one'; write one integer a line"), ("node\n1\n2\n", "got 'node'"),
    ("1.5\n", "one integer a line"), ("1\n125\n", "got 125; count from 0: these"),
    ("0\n1\n1\n0\n0\n", "5 numbers that are 0 or 1, a mask"),
])
def test_bad_fixed_file(grid, tmp_path, text, message):
    (tmp_path / "fixed.txt").write_text(text)
    with pytest.raises(InputError, match=message):
        import_vtu(save(grid, tmp_path), fixed=tmp_path / "fixed.txt")


@pytest.mark.parametrize("value", [0.5, np.nan, 2.0, -1.0])
def test_fixed_is_0_or_1(grid, tmp_path, value):
    held = np.zeros(grid.n_points)
    held[:4] = value
    grid.point_data["fixed"] = held
    with pytest.raises(InputError, match="0 or 1 for each point"):
        import_vtu(save(grid, tmp_path))


def test_fixed_cells_are_refused(grid, tmp_path):
    del grid.point_data["fixed"]
    grid.cell_data["fixed"] = np.zeros(grid.n_cells)
    with pytest.raises(InputError, match="data of cells; write 1 at each node"):
        import_vtu(save(grid, tmp_path))


def test_numbers_that_are_no_parts(grid, tmp_path):
    grid.cell_data["index"] = np.arange(grid.n_cells)
    grid.point_data["part"] = np.where(grid.point_data["part"] == 1, 65537, 0)  # 1 in sixteen bits
    path = save(grid, tmp_path)
    for array in (None, "index"):
        with pytest.raises(InputError, match="at most 255 rigid parts"):
            import_vtu(path, part_array=array)


def test_unknown_part_labels(grid, tmp_path):
    grid.point_data["part"][0] = 7
    with pytest.raises(InputError, match="unknown part labels"):
        import_vtu(save(grid, tmp_path))


@pytest.mark.parametrize("names", [["a", "a"], ["", "b"]])
def test_names_of_parts_differ(grid, tmp_path, names):
    grid.point_data["part"][0] = 2
    path = save(grid, tmp_path)
    with pytest.raises(InputError, match="a name of its own for each rigid part"):
        import_vtu(path, rigid_names=names)
    assert import_vtu(path, rigid_names=["a", "b"]).rigid_names == ("a", "b")


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


def test_the_corners_of_quadratic_cells_can_be_read(tmp_path):
    mesh = box_mesh(cavity=CAVITY)
    grid = mesh.with_order(2).grid()
    with pytest.raises(InputError, match="got cells of type quadratic_tetra; write their corners alone"):
        import_vtu(save(grid, tmp_path))
    linear = pv.UnstructuredGrid({10: grid.cells_dict[24][:, :4]}, grid.points).clean()  # as the message says
    assert import_vtu(save(linear, tmp_path)).cell_volumes.sum() == pytest.approx(mesh.cell_volumes.sum())


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


def flat_cells(grid):
    """The grid with triangles, lines and a point beside the tetrahedra, and a loose point that only a line uses."""
    cells = grid.cells_dict[pv.CellType.TETRA]
    points = np.vstack([[[99.0, 0, 0]], grid.points])
    kinds = {
        pv.CellType.TRIANGLE: cells[:5, :3] + 1, pv.CellType.LINE: np.array([[0, 1]]), pv.CellType.TETRA: cells + 1,
        pv.CellType.VERTEX: np.array([[3]]),
    }
    mixed = pv.UnstructuredGrid(kinds, points)
    mixed.point_data["part"] = np.concatenate([[0], grid.point_data["part"]])
    return mixed


def test_cells_of_lower_dimension_are_left_out(grid, tmp_path):
    want = import_vtu(save(grid, tmp_path))
    (tmp_path / "fixed.txt").write_text("1 2")  # ids of the file, in which the loose point is 0
    got = import_vtu(save(flat_cells(grid), tmp_path), fixed=tmp_path / "fixed.txt")
    np.testing.assert_array_equal(got.points, want.points)
    np.testing.assert_array_equal(got.cells, want.cells)
    np.testing.assert_array_equal(got.part, want.part)
    np.testing.assert_array_equal(np.flatnonzero(got.fixed), [0, 1])


def gmsh(mesh, labels):
    points = "".join(f"{k} {x} {y} {z}\n" for k, (x, y, z) in enumerate(mesh.points, start=1))
    cells = "".join(
        f"{k} 4 2 {tag} {tag} {a} {b} {c} {d}\n" for k, (tag, (a, b, c, d)) in
        enumerate(zip(labels, mesh.cells + 1, strict=True), start=1)
    )
    return (f"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{mesh.n_points}\n{points}$EndNodes\n"
            f"$Elements\n{len(mesh.cells)}\n{cells}$EndElements\n")


def test_other_files_of_the_same_tetrahedra(grid, tmp_path):
    pytest.importorskip("meshio")
    mesh = import_vtu(save(grid, tmp_path))
    (tmp_path / "mesh.vtu").rename(tmp_path / "UPPER.VTU")
    grid.save(tmp_path / "legacy.vtk")
    (tmp_path / "a.msh").write_text(gmsh(mesh, np.ones(len(mesh.cells), dtype=int)))
    for name in ("UPPER.VTU", "legacy.vtk", "a.msh"):
        got = import_vtu(tmp_path / name)
        np.testing.assert_allclose(got.points, mesh.points, atol=1e-4)
        np.testing.assert_array_equal(np.sort(got.cells), np.sort(mesh.cells))
    (tmp_path / "a.step").write_text("x")
    with pytest.raises(InputError, match=r"a file of type \.step"):
        import_vtu(tmp_path / "a.step")


def test_parts_of_cells_become_cavities(tmp_path):
    solid, hollow = box_mesh(), box_mesh(cavity=CAVITY)
    centres = solid.points[solid.cells].mean(axis=1)
    rigid = (np.abs(centres[:, 0]) < 10) & (np.abs(centres[:, 1]) < 10) & (centres[:, 2] > -10) & (centres[:, 2] < 0)
    grid = pv.UnstructuredGrid({pv.CellType.TETRA: solid.cells}, solid.points)
    grid.cell_data["material"] = np.where(rigid, 40, 7)
    got = import_vtu(save(grid, tmp_path), part_array="material", soft_labels=(7,), rigid_names=["block"])
    assert got.n_points == hollow.n_points
    assert np.isclose(got.cell_volumes.sum(), hollow.cell_volumes.sum())
    order = np.lexsort(got.points.T), np.lexsort(hollow.points.T)
    np.testing.assert_array_equal(got.part[order[0]], hollow.part[order[1]])
    with pytest.raises(InputError, match="material"):
        import_vtu(tmp_path / "mesh.vtu", part_array="labels")


def test_unknown_tissue_numbers(grid, tmp_path):
    grid.cell_data["tissue"] = np.full(grid.n_cells, 3)
    with pytest.raises(InputError, match="tissue numbers 0"):
        import_vtu(save(grid, tmp_path))
