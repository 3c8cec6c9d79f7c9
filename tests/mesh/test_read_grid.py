"""Foreign files that would end or fill the process that reads them are refused in one line."""

import re

import numpy as np
import pytest
import pyvista as pv

from mixpinn.base.errors import InputError
from mixpinn.mesh.read_grid import read_tetrahedra
from mixpinn.mesh.surfaces.surface import Surface
from mixpinn.records import Probe


@pytest.fixture(scope="module")
def grid():
    return pv.ImageData(dimensions=(4, 4, 4)).to_tetrahedra()


def refused(read, path):
    with pytest.raises(InputError, match=re.escape(path.name)) as caught:
        read(path)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 500


COUNTS = [
    ("vtu", 'NumberOfPoints="64"', 'NumberOfPoints="-7"'), ("vtu", 'NumberOfPoints="64"', 'NumberOfPoints="900000000"'),
    ("vtu", 'NumberOfPoints="64"', 'NumberOfPoints="63"'), ("vtu", 'NumberOfCells="135"', 'NumberOfCells="-7"'),
    ("vtu", 'NumberOfCells="135"', 'NumberOfCells="0"'), ("vtk", "POINTS 64", "POINTS -7"),
    ("vtk", "POINTS 64", "POINTS 2000000000"), ("vtk", "CELLS 136", "CELLS 900000000"),
    ("msh", "$Nodes\n64", "$Nodes\n2000000000"), ("msh", "$Elements\n135", "$Elements\n-1"),
]


@pytest.mark.parametrize(("kind", "sound", "damaged"), COUNTS)
def test_counts_that_are_not_there(grid, tmp_path, kind, sound, damaged):
    path = tmp_path / f"given.{kind}"
    if kind == "msh":
        import meshio

        cells = {"tetra": grid.cells_dict[pv.CellType.TETRA]}
        data = {"gmsh:physical": [np.ones(135, int)], "gmsh:geometrical": [np.ones(135, int)]}
        meshio.Mesh(grid.points, cells, cell_data=data).write(path, file_format="gmsh22", binary=False)
    else:
        grid.save(path, binary=kind == "vtu")
    assert read_tetrahedra(path).n_cells == 135
    text = path.read_text()
    assert text.count(sound) == 1
    path.write_text(text.replace(sound, damaged))
    refused(read_tetrahedra, path)


GMSH_4 = """$MeshFormat
4.1 0 8
$EndMeshFormat
$Entities
0 0 1 1
5 0 0 0 100 100 0 0 0
1 0 0 0 100 100 100 0 1 -5
$EndEntities
$Nodes
1 5 1 5
3 1 0 5
1
2
3
4
5
0 0 0
100 0 0
0 100 0
0 0 100
100 100 100
$EndNodes
$Elements
2 3 1 3
2 5 2 1
1 1 2 3
3 1 4 2
2 1 2 3 4
3 2 3 4 5
$EndElements
"""
"""As Gmsh writes it: a volume with the tags of the surfaces round it."""


def test_a_mesh_of_gmsh_in_version_4(tmp_path):
    (tmp_path / "a.msh").write_text(GMSH_4)
    found = read_tetrahedra(tmp_path / "a.msh")
    assert found.cells_dict[pv.CellType.TETRA].tolist() == [[0, 1, 2, 3], [1, 2, 3, 4]]
    assert found.points[4].tolist() == [100.0, 100.0, 100.0]


@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize("kind", ["vtu", "vtk"])
def test_meshes_that_were_cut_short(grid, tmp_path, kind, binary):
    path = tmp_path / f"given.{kind}"
    grid.save(path, binary=binary)
    path.write_bytes(path.read_bytes()[:-400])
    refused(read_tetrahedra, path)


@pytest.mark.parametrize(("mark", "count"), [(1, 5), (32, 5), (2, 0)])
def test_cells_of_another_piece(grid, tmp_path, mark, count):
    marked = grid.copy()
    marked.cell_data["vtkGhostType"] = np.where(np.arange(135) < 5, mark, 0).astype(np.uint8)
    marked.save(tmp_path / "piece.vtu")
    if count:
        with pytest.raises(InputError, match="got 5 ghost cells"):
            read_tetrahedra(tmp_path / "piece.vtu")
    else:  # a cell of its own, with many neighbours
        assert read_tetrahedra(tmp_path / "piece.vtu").n_cells == 135


def test_tetrahedra_with_three_points(grid, tmp_path):
    grid.save(tmp_path / "given.vtk", binary=False)
    text = (tmp_path / "given.vtk").read_text()
    (tmp_path / "given.vtk").write_text(re.sub(r"(CELL_TYPES \d+\s+)10", r"\g<1>77", text))
    refused(read_tetrahedra, tmp_path / "given.vtk")


@pytest.mark.parametrize("read", [Probe.load, Surface.load])
@pytest.mark.parametrize(("name", "binary"), [
    ("s.stl", True), ("s.stl", False), ("s.ply", True), ("s.vtp", True), ("s.obj", True),
])
def test_surfaces_that_were_cut_short(tmp_path, read, name, binary):
    path = tmp_path / name
    pv.Sphere(radius=20.0).save(path, **({} if name == "s.obj" else {"binary": binary}))
    assert len(read(path).triangles) == 1680
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
    refused(read, path)
