"""Reading tetrahedra from whatever file they are in: volume cells and the data on them, nothing of lower dimension."""

import contextlib
import io
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv

from mixpinn.base.arrays import AnyArray
from mixpinn.base.errors import InputError

MESH_SUFFIXES = (
    ".vtu", ".vtk", ".msh", ".inp", ".mesh", ".med", ".xdmf", ".e", ".exo", ".bdf", ".nas", ".pvtu", ".vtm",
)
"""Endings of files that may hold tetrahedra, in upper or lower case."""
ORIGINAL = "original_index"
"""Point data: the index of each point in the file, where points were left out."""
_VTK = {".vtu", ".vtk", ".pvtu", ".vtm", ".e", ".exo"}
_FLAT = {
    kind for kind in pv.CellType
    if kind.name in (
        "EMPTY_CELL", "VERTEX", "POLY_VERTEX", "LINE", "POLY_LINE", "TRIANGLE", "TRIANGLE_STRIP", "POLYGON", "PIXEL",
        "QUAD", "QUADRATIC_EDGE", "QUADRATIC_TRIANGLE", "QUADRATIC_QUAD",
    )
}
_EXPECTED, _FIX = "a readable tetrahedral mesh (.vtu, .vtk, .msh)", "check the path or export the mesh again as .vtu"


def read_tetrahedra(path: Path) -> pv.UnstructuredGrid:
    """The linear tetrahedra of a file, with their data and the points that they use.

    Points, lines and faces beside them are left out, and so are points that only those used.

    Raises:
        InputError: absent, unreadable, no tetrahedra, or other volume cells beside them.
    """
    grid = _read(path)
    kinds = {pv.CellType(kind) for kind in np.unique(grid.celltypes)}
    other = {kind.name.lower() for kind in kinds - _FLAT} - {"tetra"}
    if other or pv.CellType.TETRA not in kinds:
        raise InputError(
            str(path), expected="linear tetrahedra only",
            got="cells of type " + ", ".join(sorted(other or {kind.name.lower() for kind in kinds})),
            fix="extract the tetrahedra or convert the mesh",
        )
    return grid if len(kinds) == 1 else _without_flat_cells(grid)


def _read(path: Path) -> pv.UnstructuredGrid:
    if not path.is_file():
        raise InputError(str(path), expected=_EXPECTED, got="no such file", fix=_FIX)
    suffix = path.suffix.lower()
    if suffix not in MESH_SUFFIXES:
        raise InputError(str(path), expected=_EXPECTED, got=f"a file of type {suffix or 'without suffix'}", fix=_FIX)
    try:
        with pv.vtk_verbosity("off"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            grid = pv.read(path, force_ext=suffix) if suffix in _VTK else pv.from_meshio(_through_meshio(path))
            if isinstance(grid, pv.MultiBlock):
                grid = grid.combine(merge_points=False)
    except Exception as error:  # readers raise many kinds: XML, encoding, structure
        raise InputError(str(path), expected=_EXPECTED, got=f"{type(error).__name__}: {error}", fix=_FIX) from error
    if not isinstance(grid, pv.UnstructuredGrid) or not grid.n_cells:
        got = f"a damaged file or no cells ({type(grid).__name__})"
        raise InputError(str(path), expected=_EXPECTED, got=got, fix=_FIX)
    return grid


def _through_meshio(path: Path) -> Any:
    import meshio

    try:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            return meshio.read(path)
    except SystemExit as error:  # its way to say that a file cannot be read
        raise ValueError(f"not a file of type {path.suffix.lower()}") from error


def _without_flat_cells(grid: pv.UnstructuredGrid) -> pv.UnstructuredGrid:
    cells = np.asarray(grid.cells_dict[pv.CellType.TETRA])
    chosen = np.asarray(grid.celltypes) == pv.CellType.TETRA
    flat_points = np.zeros(grid.n_points, dtype=bool)
    ends = np.asarray(grid.cell_offsets)
    lengths = np.diff(ends)
    flat_points[np.asarray(grid.cell_connectivity)[np.repeat(~chosen, lengths)]] = True
    flat_points[cells] = False
    return keep(grid, cells, chosen, ~flat_points)


def keep(grid: pv.UnstructuredGrid, cells: AnyArray, chosen: AnyArray, points: AnyArray) -> pv.UnstructuredGrid:
    """A grid of the tetrahedra `cells` with the data of the cells `chosen` and of the points `points` (masks)."""
    number = np.cumsum(points) - 1
    result = pv.UnstructuredGrid({pv.CellType.TETRA: number[cells]}, np.asarray(grid.points)[points])
    for name in grid.point_data:
        result.point_data[name] = np.asarray(grid.point_data[name])[points]
    for name in grid.cell_data:
        result.cell_data[name] = np.asarray(grid.cell_data[name])[chosen]
    for name in grid.field_data:
        result.field_data[name] = grid.field_data[name]
    if ORIGINAL not in result.point_data:
        result.point_data[ORIGINAL] = np.flatnonzero(points)
    return result
