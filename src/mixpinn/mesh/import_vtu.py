"""Import of ready tetrahedral meshes."""

import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyvista as pv

from mixpinn.base.arrays import AnyArray, BoolArray
from mixpinn.base.errors import InputError
from mixpinn.mesh.label import fixed_nodes
from mixpinn.mesh.orientation import check_cells, orient_cells
from mixpinn.records.tissue_mesh import TissueMesh

_PART_ARRAYS = ("part", "rigid")
_SOFT_INDEX = "deformable_id"
_LUMBAR = tuple(f"vertebrae_L{level}" for level in range(1, 6))


def import_vtu(
    path: Path | str, *, fixed: Path | str | None = None, rigid_names: Sequence[str] | None = None,
) -> TissueMesh:
    """Import a ``.vtu`` (or any file of tetrahedra that `pyvista` reads), already in the world frame.

    The part of each node is read from the point data ``part`` or ``rigid`` (0 soft, k = 1 … K rigid part k); without
    either all is soft tissue. Cells of negative volume are re-oriented.

    Args:
        path: the mesh, lengths in mm.
        fixed: text file of the indices of the fixed nodes. Where the mesh has point data ``deformable_id``, they
            count within the soft nodes by that array, otherwise within all nodes. Without a file the point data
            ``fixed`` decides, and without that the protocol's rule (`mixpinn.mesh.fixed_nodes`).
        rigid_names: names of the rigid parts 1 … K; by default those in the file, else ``part 1``, ``part 2``, …

    Raises:
        InputError: unreadable, not tetrahedra, flat or overlapping cells, unknown part labels, bad indices.
    """
    path = Path(path)
    grid = _read(path)
    what = str(path)
    points = np.asarray(grid.points, dtype=np.float64)
    if not np.isfinite(points).all():
        raise InputError(what, expected="finite points", got="NaN or infinity", fix="write the mesh again")
    cells = orient_cells(points, np.asarray(grid.cells_dict[pv.CellType.TETRA]))
    check_cells(points, cells, what=what)
    if (unused := len(points) - len(np.unique(cells))) > 0:
        raise InputError(
            what, expected="points that all belong to cells", got=f"{unused} loose points",
            fix="remove them (pyvista: grid.clean())",
        )
    part, names = _parts(grid, rigid_names, what)
    tissue_names = tuple(str(name) for name in grid.field_data.get("tissue_names", ["soft tissue"]))
    tissue = np.asarray(grid.cell_data.get("tissue", np.zeros(len(cells)))).astype(np.int16)
    mesh = TissueMesh(points, cells, part, np.zeros(len(points), dtype=bool), names, tissue, tissue_names)
    if fixed is not None:
        held = _read_fixed(Path(fixed), grid)
    elif "fixed" in grid.point_data:
        held = np.asarray(grid.point_data["fixed"]).astype(bool)
    else:
        held = fixed_nodes(mesh)
    return replace(mesh, fixed=held)


def load_paper_mesh(folder: Path | str) -> TissueMesh:
    """The mesh of the paper from a folder with ``body.vtu`` and ``fixed.txt``."""
    folder = Path(folder)
    return import_vtu(folder / "body.vtu", fixed=folder / "fixed.txt", rigid_names=_LUMBAR)


def _read(path: Path) -> pv.UnstructuredGrid:
    expected, fix = "a readable tetrahedral mesh (.vtu)", "check the path or export the mesh again"
    if not path.is_file():
        raise InputError(str(path), expected=expected, got="no such file", fix=fix)
    try:
        with pv.vtk_verbosity("off"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            grid = pv.read(path)
    except Exception as error:  # readers raise many kinds: unknown suffix, XML, encoding
        raise InputError(str(path), expected=expected, got=f"{type(error).__name__}: {error}", fix=fix) from error
    if not isinstance(grid, pv.UnstructuredGrid) or not grid.n_cells:
        got = f"a damaged file or no cells ({type(grid).__name__})"
        raise InputError(str(path), expected=expected, got=got, fix=fix)
    kinds = {pv.CellType(kind).name.lower() for kind in np.unique(grid.celltypes)} - {"tetra"}
    if kinds:
        raise InputError(
            str(path), expected="linear tetrahedra only", got="cells of type " + ", ".join(sorted(kinds)),
            fix="extract the tetrahedra or convert the mesh",
        )
    return grid


def _parts(grid: pv.UnstructuredGrid, names: Sequence[str] | None, what: str) -> tuple[AnyArray, tuple[str, ...]]:
    found = next((name for name in _PART_ARRAYS if name in grid.point_data), None)
    labels = np.asarray(grid.point_data[found]) if found else np.zeros(grid.n_points)
    if labels.ndim != 1 or not np.isfinite(labels).all() or (labels != np.floor(labels)).any() or labels.min() < 0:
        raise InputError(
            what, expected=f"part labels 0, 1, … in point data {found!r}", got="negative or fractional ones",
            fix="use 0 for soft tissue and k = 1 … K for rigid part k",
        )
    part = labels.astype(np.int16)
    if names is None and "rigid_names" in grid.field_data:
        names = [str(name) for name in grid.field_data["rigid_names"] if str(name)]
    if names is None:
        names = [f"part {k}" for k in range(1, int(part.max()) + 1)]
    unknown = sorted(set(np.unique(part).tolist()) - set(range(len(names) + 1)))
    absent = sorted(set(range(1, len(names) + 1)) - set(np.unique(part).tolist()))
    if unknown or absent:
        raise InputError(
            what, expected=f"nodes with each of the part labels 1 … {len(names)}",
            got=f"unknown part labels {unknown}" if unknown else f"no node with part label {absent}",
            fix="number the rigid parts without gaps and name every one",
        )
    return part, tuple(names)


def _read_fixed(path: Path, grid: pv.UnstructuredGrid) -> BoolArray:
    expected = "a text file of node indices"
    try:
        indices = np.array(path.read_text().split(), dtype=np.int64)
    except OSError as error:
        got = error.strerror or str(error)
        raise InputError(str(path), expected=expected, got=got, fix="check the path") from error
    except ValueError as error:
        raise InputError(str(path), expected=expected, got=str(error), fix="write one integer a line") from error
    in_soft = _SOFT_INDEX in grid.point_data
    index = np.asarray(grid.point_data[_SOFT_INDEX]) if in_soft else np.arange(grid.n_points)
    known = np.isin(indices, index[index >= 0])
    if not known.all():
        raise InputError(
            str(path), expected=f"indices of {'soft nodes' if in_soft else 'nodes'} up to {index.max()}",
            got=f"{indices[~known][0]}", fix="use the list that belongs to this mesh",
        )
    held: BoolArray = np.isin(index, indices) & (index >= 0)
    return held
