"""Reading tetrahedra from whatever file they are in: volume cells and the data on them, nothing of lower dimension."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mixpinn.base.arrays import AnyArray
from mixpinn.base.errors import InputError
from mixpinn.base.reader_process import read_apart
from mixpinn.base.validated import ArraySpec
from mixpinn.records.grid_file import grid_arrays

if TYPE_CHECKING:
    import pyvista as pv

MESH_SUFFIXES = (
    ".vtu", ".vtk", ".msh", ".inp", ".mesh", ".med", ".xdmf", ".e", ".exo", ".bdf", ".nas", ".pvtu", ".vtm",
)
"""Endings of files that may hold tetrahedra, in upper or lower case."""
ORIGINAL = "original_index"
"""Point data: the index of each point in the file, where points were left out."""
_FLAT = {
    "empty_cell", "vertex", "poly_vertex", "line", "poly_line", "triangle", "triangle_strip", "polygon", "pixel",
    "quad", "quadratic_edge", "quadratic_triangle", "quadratic_quad",
}
TETRA = 10
"""VTK's number of a tetrahedron of four points."""
_GHOSTS, _NOT_OF_THIS = "vtkGhostType", 1 | 8 | 32
"""VTK's array of marks, and those of cells that are another piece's, cut finer elsewhere, or hidden."""
_CORNERS = (
    "write their corners alone (pyvista.UnstructuredGrid({10: grid.cells_dict[24][:, :4]}, grid.points).clean()); "
    "'mixpinn mesh --set element=quadratic' puts the middles of edges back"
)
_EXPECTED, _FIX = "a readable tetrahedral mesh (.vtu, .vtk, .msh)", "check the path or export the mesh again as .vtu"


def read_tetrahedra(path: Path) -> "pv.UnstructuredGrid":
    """The linear tetrahedra of a file, with their data and the points that they use.

    Points, lines and faces beside them are left out, and so are points that only those used.

    Raises:
        InputError: absent, unreadable, no tetrahedra, or other volume cells or ghost cells beside them.
    """
    import pyvista as pv

    arrays, about = _read(path)
    types, lengths = arrays["types"], np.diff(arrays["offsets"])
    names = {int(kind): kind.name.lower() for kind in pv.CellType}
    kinds = {names.get(kind, f"number {kind}") for kind in np.unique(types).tolist()}
    chosen = types == TETRA
    other = kinds - _FLAT - {"tetra"}
    if other or not chosen.any():
        quadratic = other == {"quadratic_tetra"} and not chosen.any()
        raise InputError(
            str(path), expected="linear tetrahedra only", got="cells of type " + ", ".join(sorted(other or kinds)),
            fix=_CORNERS if quadratic else "extract the tetrahedra or convert the mesh",
        )
    if (lengths[chosen] != 4).any():
        raise InputError(str(path), expected="four points a tetrahedron", got="another number", fix=_FIX)
    if _GHOSTS in about["cell_data"]:
        marks = arrays[f"cell_data.{about['cell_data'].index(_GHOSTS)}"][chosen]
        if marks.dtype.kind in "iu" and (ghosts := int(np.count_nonzero(marks.astype(np.int64) & _NOT_OF_THIS))):
            raise InputError(
                str(path), expected="cells that are the mesh's own", got=f"{ghosts} ghost cells ({_GHOSTS})",
                fix="write it without them (pyvista: grid.RemoveGhostCells())",
            )
    corners = arrays["connectivity"]
    cells = corners[arrays["offsets"][:-1][chosen][:, None] + np.arange(4)]
    grid = _grid(cells, chosen, arrays, about)
    if chosen.all():
        return grid
    flat = np.zeros(grid.n_points, dtype=bool)
    flat[corners[np.repeat(~chosen, lengths)]] = True
    flat[cells] = False
    return keep(grid, cells, np.ones(len(cells), dtype=bool), ~flat)


def _read(path: Path) -> tuple[dict[str, AnyArray], Any]:
    """The arrays of `grid_arrays`, checked: what is wrong in a file may come out of its reader, too."""
    if not path.is_file():
        raise InputError(str(path), expected=_EXPECTED, got="no such file", fix=_FIX)
    suffix = path.suffix.lower()
    if suffix not in MESH_SUFFIXES:
        raise InputError(str(path), expected=_EXPECTED, got=f"a file of type {suffix or 'without suffix'}", fix=_FIX)
    try:
        arrays, about = read_apart(grid_arrays, path)
    except ValueError as error:
        fix = _FIX + (", or from Gmsh in version 2.2 (-format msh2)" if suffix == ".msh" else "")
        raise InputError(str(path), expected=_EXPECTED, got=str(error), fix=fix) from error
    if single := [name for name, values in arrays.items() if not values.ndim]:
        raise InputError(str(path), expected="arrays", got=f"a single number ({', '.join(single)[:80]})", fix=_FIX)
    corners, offsets, count = arrays["connectivity"], arrays["offsets"], len(arrays["types"])
    specs = {
        "points": ArraySpec("number", ("points", 3)), "types": ArraySpec("index", ("cells",), low=0),
        "offsets": ArraySpec("index", (count + 1,), low=0, high=len(corners)),
        "connectivity": ArraySpec("index", ("corners",), low=0, high=len(arrays["points"]) - 1),
    }
    for name, spec in specs.items():
        spec.check(arrays[name], f"{path}: {name}", extents={}, remake=_FIX)
    if offsets[0] != 0 or offsets[-1] != len(corners) or (np.diff(offsets) < 0).any():
        raise InputError(str(path), expected="cells one after the other", got="cells that overlap", fix=_FIX)
    for group, length in (("point_data", len(arrays["points"])), ("cell_data", count)):
        for index, name in enumerate(about[group]):
            if len(arrays[f"{group}.{index}"]) != length:
                raise InputError(
                    f"{path}: {name}", expected=f"{length} values", got=str(len(arrays[f"{group}.{index}"])), fix=_FIX,
                )
    return arrays, about


def _grid(cells: AnyArray, chosen: AnyArray, arrays: dict[str, AnyArray], about: Any) -> "pv.UnstructuredGrid":
    import pyvista as pv

    grid = pv.UnstructuredGrid({TETRA: cells}, arrays["points"])
    for index, name in enumerate(about["point_data"]):
        grid.point_data[name] = arrays[f"point_data.{index}"]
    for index, name in enumerate(about["cell_data"]):
        grid.cell_data[name] = arrays[f"cell_data.{index}"][chosen]
    for index, name in enumerate(about["field_data"]):
        grid.field_data[name] = arrays[f"field_data.{index}"]
    for name, texts in about["text"].items():
        grid.field_data[name] = texts
    return grid


def keep(grid: "pv.UnstructuredGrid", cells: AnyArray, chosen: AnyArray, points: AnyArray) -> "pv.UnstructuredGrid":
    """A grid of the tetrahedra `cells` with the data of the cells `chosen` and of the points `points` (masks)."""
    import pyvista as pv

    number = np.cumsum(points) - 1
    result = pv.UnstructuredGrid({TETRA: number[cells]}, np.asarray(grid.points)[points])
    for name in grid.point_data:
        result.point_data[name] = np.asarray(grid.point_data[name])[points]
    for name in grid.cell_data:
        result.cell_data[name] = np.asarray(grid.cell_data[name])[chosen]
    for name in grid.field_data:
        result.field_data[name] = grid.field_data[name]
    if ORIGINAL not in result.point_data:
        result.point_data[ORIGINAL] = np.flatnonzero(points)
    return result
