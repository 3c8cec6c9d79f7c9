import resource

import numpy as np
import pytest
import pyvista as pv

from mixpinn.base.errors import InputError
from mixpinn.records.vtk_file import write_vtk


@pytest.fixture
def grid():
    grid = pv.ImageData(dimensions=(6, 6, 6)).to_tetrahedra()
    grid.point_data["number"] = np.arange(grid.n_points)
    grid.field_data["names"] = ["first", "second part"]
    return grid


def test_grid_round_trip(grid, tmp_path):
    write_vtk(tmp_path / "a.vtu", grid)
    read = pv.read(tmp_path / "a.vtu")
    np.testing.assert_array_equal(read.points, grid.points)
    np.testing.assert_array_equal(read.cells, grid.cells)
    np.testing.assert_array_equal(read.point_data["number"], grid.point_data["number"])
    assert list(read.field_data["names"]) == ["first", "second part"]


@pytest.mark.parametrize("suffix", [".stl", ".ply", ".vtp"])
def test_surface_round_trip(grid, tmp_path, suffix):
    surface = grid.extract_surface(algorithm="dataset_surface").triangulate()
    write_vtk(tmp_path / f"a{suffix}", surface)
    assert pv.read(tmp_path / f"a{suffix}").n_cells == surface.n_cells


@pytest.mark.parametrize("suffix", [".vtu", ".stl", ".ply"])
def test_full_disk_is_an_ordinary_error(grid, tmp_path, suffix):
    dataset = grid if suffix == ".vtu" else grid.extract_surface(algorithm="dataset_surface").triangulate()
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
    try:
        with pytest.raises(InputError, match="free some space"):
            write_vtk(tmp_path / f"a{suffix}", dataset)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert not list(tmp_path.iterdir())
