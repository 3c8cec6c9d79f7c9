"""The reader of .vtu against VTK's own, in every encoding that VTK writes; and what is damaged."""

import re

import numpy as np
import pytest
import pyvista as pv
from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

from mixpinn.base.errors import InputError
from mixpinn.records import TissueMesh
from mixpinn.records.vtu import TetraGrid
from mixpinn.records.vtu_parse import UnknownEncodingError, parse_vtu
from records.test_tissue_mesh import MESH


@pytest.fixture(scope="module")
def grid():
    grid = pv.ImageData(dimensions=(17, 16, 15)).to_tetrahedra()
    rng = np.random.default_rng(0)
    grid.points = grid.points + rng.normal(scale=0.1, size=grid.points.shape)
    grid.point_data["part"] = rng.integers(-9, 9, grid.n_points).astype(np.int16)
    grid.point_data["vector"] = rng.normal(size=(grid.n_points, 3)).astype(np.float32)
    grid.cell_data["tissue"] = rng.integers(0, 255, grid.n_cells).astype(np.uint8)
    grid.field_data["names"] = ["", "a b", "", "<&>"]
    grid.field_data["matrix"] = np.eye(4)
    return grid


def written(grid, path, *, mode, packing, base64, words, big):
    writer = vtkXMLUnstructuredGridWriter()
    writer.SetInputData(grid)
    getattr(writer, f"SetDataModeTo{mode}")()
    writer.SetCompressorType(getattr(writer, packing))
    writer.SetEncodeAppendedData(base64)
    writer.SetHeaderType(words)
    writer.SetByteOrder(not big)
    writer.SetFileName(str(path))
    writer.Write()
    return path.read_bytes()


@pytest.mark.parametrize("words", [32, 64])
@pytest.mark.parametrize("packing", ["NONE", "ZLIB", "LZMA"])
@pytest.mark.parametrize(("mode", "base64", "big"), [
    ("Ascii", False, False), ("Binary", False, False), ("Binary", False, True), ("Appended", False, False),
    ("Appended", True, False),
])
def test_the_same_as_vtk_reads(grid, tmp_path, mode, base64, big, packing, words):
    content = written(grid, tmp_path / "x.vtu", mode=mode, packing=packing, base64=base64, words=words, big=big)
    ours, theirs = parse_vtu(content), pv.read(tmp_path / "x.vtu")
    np.testing.assert_array_equal(ours.points, theirs.points)
    np.testing.assert_array_equal(ours.connectivity, theirs.cell_connectivity)
    np.testing.assert_array_equal(ours.offsets, theirs.cell_offsets[1:])
    np.testing.assert_array_equal(ours.types, theirs.celltypes)
    for name in ("part", "vector"):
        np.testing.assert_array_equal(ours.point_data[name], theirs.point_data[name])
        assert ours.point_data[name].dtype == grid.point_data[name].dtype
    np.testing.assert_array_equal(ours.cell_data["tissue"], theirs.cell_data["tissue"])
    assert ours.field_data["names"] == list(grid.field_data["names"])
    np.testing.assert_array_equal(np.ravel(ours.field_data["matrix"]), np.eye(4).ravel())


def test_another_compressor_is_left_to_vtk(grid, tmp_path):
    path = tmp_path / "x.vtu"
    content = written(grid, path, mode="Binary", packing="LZ4", base64=False, words=32, big=False)
    with pytest.raises(UnknownEncodingError, match="LZ4"):
        parse_vtu(content)
    read = TetraGrid.read(path)
    np.testing.assert_array_equal(read.cells, grid.cells_dict[pv.CellType.TETRA])
    np.testing.assert_array_equal(read.cell_data["tissue"], grid.cell_data["tissue"])
    assert read.field_data["names"] == list(grid.field_data["names"])


def replaced(pattern, by):
    return lambda text: re.sub(pattern, by, text, count=1)


def other_block(text):
    """The first word of an array's header: the number of its blocks."""
    return re.sub(r"(Name=\"Points\".*?>\s*)AQAAAA", r"\1/////w", text, count=1, flags=re.DOTALL)


DAMAGE = {
    "negative points": replaced('NumberOfPoints="5"', 'NumberOfPoints="-7"'),
    "many points": replaced('NumberOfPoints="5"', 'NumberOfPoints="1000000000000"'),
    "endless points": replaced('NumberOfPoints="5"', f'NumberOfPoints="{"9" * 40}"'),
    "a point too few": replaced('NumberOfPoints="5"', 'NumberOfPoints="4"'),
    "negative cells": replaced('NumberOfCells="2"', 'NumberOfCells="-2"'),
    "many cells": replaced('NumberOfCells="2"', 'NumberOfCells="900000000"'),
    "a cell too few": replaced('NumberOfCells="2"', 'NumberOfCells="1"'),
    "no cells": replaced('NumberOfCells="2"', 'NumberOfCells="0"'),
    "another type": replaced(r'type="\w+"([^>]*Name="connectivity")', r'type="Float64"\1'),
    "an unknown type": replaced('type="Float64" Name="Points"', 'type="Float99" Name="Points"'),
    "wide data": replaced('Name="part"', 'Name="part" NumberOfComponents="4000000000"'),
    "endless blocks": other_block, "half": lambda text: text[: len(text) // 2], "nothing": lambda text: "",
    "an entity": lambda text: text.replace('<VTKFile', '<!DOCTYPE a [<!ENTITY b "c">]><VTKFile', 1),
    "another file": replaced('type="UnstructuredGrid"', 'type="PolyData"'),
    "another order of bytes": replaced("LittleEndian", "BigEndian"),
    "an unknown format": replaced('format="binary"', 'format="sound"'),
    "no base64": replaced("eJ", "%%"), "a letter": replaced("eJx", "eJy"),
    "no names": replaced('Name="rigid_names"', 'Name="bold_names"'),
    "other names": replaced('NumberOfTuples="1"', 'NumberOfTuples="2"'),
    "no points": replaced("<Points>", "<Dots>"),
}


@pytest.mark.parametrize("kind", DAMAGE)
def test_a_damaged_mesh_is_refused(tmp_path, kind):
    MESH.save(tmp_path / "mesh.vtu")
    text = (tmp_path / "mesh.vtu").read_text()
    assert TissueMesh.load(tmp_path / "mesh.vtu").hash() == MESH.hash()
    (tmp_path / "mesh.vtu").write_text(DAMAGE[kind](text))
    assert DAMAGE[kind](text) != text
    with pytest.raises(InputError, match=r"mesh\.vtu") as caught:
        TissueMesh.load(tmp_path / "mesh.vtu")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("name", "value", "says"), [
    ("part", 2, "at most 1"), ("part", -1, "at least 0"), ("fixed", 7, "at most 1"), ("tissue", 2, "at most 1"),
])
def test_labels_that_no_mesh_has_are_refused(tmp_path, name, value, says):
    grid = MESH.grid()
    data = grid.cell_data if name == "tissue" else grid.point_data
    data[name][0] = value
    grid.save(tmp_path / "mesh.vtu")
    with pytest.raises(InputError, match=f"{name}: expected values of {says}"):
        TissueMesh.load(tmp_path / "mesh.vtu")


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_points_that_are_not_finite_are_refused(tmp_path, value):
    grid = MESH.grid()
    grid.points[0, 0] = value
    grid.save(tmp_path / "mesh.vtu")
    with pytest.raises(InputError, match="points: expected finite numbers"):
        TissueMesh.load(tmp_path / "mesh.vtu")


@pytest.mark.parametrize("value", ["266", "-246", "18446744073709551616"])
def test_numbers_that_their_type_cannot_hold_are_refused(grid, tmp_path, value):
    """266 and -246 are 10, a tetrahedron, in eight bits."""
    path = tmp_path / "x.vtu"
    content = written(grid, path, mode="Ascii", packing="NONE", base64=False, words=32, big=False)
    types = re.compile(rb'(<DataArray type="UInt8" Name="types".*?>\s*)10\b')
    altered = types.sub(rb"\g<1>" + value.encode(), content, count=1)
    assert altered != content
    with pytest.raises(ValueError, match="numbers in types that"):
        parse_vtu(altered)
