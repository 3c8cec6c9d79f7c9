"""Import of ready tetrahedral meshes."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mixpinn.base.arrays import AnyArray, BoolArray
from mixpinn.base.errors import InputError
from mixpinn.base.text import read_text
from mixpinn.base.validated import ArraySpec
from mixpinn.mesh.cells.label import fixed_nodes
from mixpinn.mesh.cells.orientation import check_cells, orient_cells
from mixpinn.mesh.read_grid import ORIGINAL, TETRA, keep, read_tetrahedra
from mixpinn.records.doubts import unpacked
from mixpinn.records.tissue_mesh import TissueMesh

if TYPE_CHECKING:
    import pyvista as pv

_PART_ARRAYS = ("part", "rigid")
_TO_SCANNER = "world_to_scanner"
_SOFT_INDEX = "deformable_id"
_MOST_PARTS = 255
_LUMBAR = tuple(f"vertebrae_L{level}" for level in range(1, 6))


def import_vtu(
    path: Path | str, *, fixed: Path | str | None = None, rigid_names: Sequence[str] | None = None,
    part_array: str | None = None, soft_labels: Sequence[int] = (0,),
) -> TissueMesh:
    """Import a ``.vtu``, or any file of tetrahedra that `pyvista` or meshio reads, already in the world frame.

    The part of each node is read from the point data ``part`` or ``rigid`` (0 soft, k = 1 … K rigid part k); without
    either all is soft tissue. Where parts are given for cells, cells of rigid parts become cavities whose boundary
    nodes belong to them. Cells of negative volume are re-oriented; points, lines and faces are left out. Of a mesh of
    this project the targets, the doubts and the place in the scanner's frame are kept.

    Args:
        path: the mesh, lengths in mm.
        fixed: text file of the indices of the fixed nodes. Where the mesh has point data ``deformable_id``, they
            count within the soft nodes by that array, otherwise within all nodes. Without a file the point data
            ``fixed`` decides, and without that the protocol's rule (`mixpinn.mesh.fixed_nodes`).
        rigid_names: names of the rigid parts 1 … K; by default those in the file, else ``part 1``, ``part 2``, …
        part_array: other point or cell data that says the part, for example ``gmsh:physical``.
        soft_labels: its values that mean soft tissue; the others are the rigid parts in ascending order.

    Raises:
        InputError: unreadable, not tetrahedra, flat or overlapping cells, unknown part labels, bad indices.
    """
    path = Path(path)
    grid = _with_parts(read_tetrahedra(path), part_array, soft_labels, str(path))
    what = str(path)
    points = np.asarray(grid.points, dtype=np.float64)
    if not np.isfinite(points).all():
        raise InputError(what, expected="finite points", got="NaN or infinity", fix="write the mesh again")
    cells = orient_cells(points, np.asarray(grid.cells_dict[TETRA]))
    check_cells(points, cells, what=what)
    if (unused := len(points) - len(np.unique(cells))) > 0:
        raise InputError(
            what, expected="points that all belong to cells", got=f"{unused} loose points",
            fix="remove them (pyvista: grid.clean())",
        )
    part, names = _parts(grid, rigid_names, what)
    tissue_names = tuple(str(name) for name in grid.field_data.get("tissue_names", ["soft tissue"]))
    tissue = _tissues(grid, len(cells), tissue_names, what)
    mesh = TissueMesh(
        points, cells, part, np.zeros(len(points), dtype=bool), names, tissue, tissue_names,
        doubts=unpacked(grid.field_data.get("doubts", ())),
        targets=tuple(str(name) for name in grid.field_data.get("targets", ()) if str(name) in names),
    )
    if _TO_SCANNER in grid.field_data:
        matrix = np.asarray(grid.field_data[_TO_SCANNER]).ravel()
        ArraySpec("number", (16,)).check(matrix, f"{what}: {_TO_SCANNER}", extents={}, remake="export the mesh again")
        mesh = replace(mesh, world_to_scanner=matrix.astype(np.float64).reshape(4, 4))
    if fixed is not None:
        held = _read_fixed(Path(fixed), grid)
    elif "fixed" in grid.point_data:
        held = _held(np.asarray(grid.point_data["fixed"]), what)
    elif "fixed" in grid.cell_data:
        raise InputError(
            what, expected="'fixed' as data of points", got="data of cells", fix="write 1 at each node that is held",
        )
    else:
        held = fixed_nodes(mesh)
    return replace(mesh, fixed=held)


def load_paper_mesh(folder: Path | str) -> TissueMesh:
    """The mesh of the paper from a folder with ``body.vtu`` and ``fixed.txt``."""
    folder = Path(folder)
    return import_vtu(folder / "body.vtu", fixed=folder / "fixed.txt", rigid_names=_LUMBAR)


def _with_parts(
    grid: "pv.UnstructuredGrid", array: str | None, soft_labels: Sequence[int], what: str,
) -> "pv.UnstructuredGrid":
    """The grid with point data ``part``, where its parts come from data of cells or under another name."""
    if array is None:
        array = next((name for name in _PART_ARRAYS if name in grid.cell_data and name not in grid.point_data), None)
        if array is None or any(name in grid.point_data for name in _PART_ARRAYS):
            return grid
    if array not in grid.point_data and array not in grid.cell_data:
        known = [*grid.point_data.keys(), *grid.cell_data.keys()]
        raise InputError(
            what, expected=f"data {array!r} on points or cells", got=", ".join(known) or "no data", fix="choose one",
        )
    of_points = array in grid.point_data
    labels = np.asarray(grid.point_data[array] if of_points else grid.cell_data[array])
    if labels.ndim != 1 or not np.isfinite(labels).all() or (labels != np.floor(labels)).any():
        raise InputError(what, expected=f"whole numbers as {array!r}", got="others", fix="number the parts")
    part = np.zeros(len(labels), dtype=np.int16)
    rigid = [value for value in np.unique(labels) if value not in set(soft_labels)]
    if len(rigid) > _MOST_PARTS:
        raise InputError(
            what, expected=f"at most {_MOST_PARTS} rigid parts in {array!r}", got=f"{len(rigid)}",
            fix="choose data that number the parts, or say with soft_labels which values mean soft tissue",
        )
    for number, label in enumerate(rigid, start=1):
        part[labels == label] = number
    if of_points:
        grid.point_data[_PART_ARRAYS[0]] = part
        return grid
    cells = np.asarray(grid.cells_dict[TETRA])
    soft, of_point = part == 0, np.zeros(grid.n_points, dtype=np.int16)
    if not soft.any():
        raise InputError(what, expected="cells of soft tissue", got="none",
                         fix="say with soft_labels which values mean soft tissue")
    for number in range(int(part.max()), 0, -1):
        of_point[cells[part == number]] = number
    grid.point_data[_PART_ARRAYS[0]] = of_point
    used = np.zeros(grid.n_points, dtype=bool)
    used[cells[soft]] = True
    return keep(grid, cells[soft], soft, used)


def _parts(grid: "pv.UnstructuredGrid", names: Sequence[str] | None, what: str) -> tuple[AnyArray, tuple[str, ...]]:
    found = next((name for name in _PART_ARRAYS if name in grid.point_data), None)
    labels = np.asarray(grid.point_data[found]) if found else np.zeros(grid.n_points)
    if labels.ndim != 1 or not np.isfinite(labels).all() or (labels != np.floor(labels)).any() or labels.min() < 0:
        raise InputError(
            what, expected=f"part labels 0, 1, … in point data {found!r}", got="negative or fractional ones",
            fix="use 0 for soft tissue and k = 1 … K for rigid part k",
        )
    if labels.max() > _MOST_PARTS:
        raise InputError(
            what, expected=f"at most {_MOST_PARTS} rigid parts in point data {found!r}", got=f"{labels.max():.0f}",
            fix="number the rigid parts 1 … K",
        )
    part = labels.astype(np.int16)
    if names is None and "rigid_names" in grid.field_data:
        names = [str(name) for name in grid.field_data["rigid_names"] if str(name)]
    if names is None:
        names = [f"part {k}" for k in range(1, int(part.max()) + 1)]
    if not all(names) or len(set(names)) < len(names):
        raise InputError(
            what, expected="a name of its own for each rigid part", got=", ".join(map(repr, names))[:200],
            fix="give rigid_names that differ",
        )
    unknown = sorted(set(np.unique(part).tolist()) - set(range(len(names) + 1)))
    absent = sorted(set(range(1, len(names) + 1)) - set(np.unique(part).tolist()))
    if unknown or absent:
        raise InputError(
            what, expected=f"nodes with each of the part labels 1 … {len(names)}",
            got=f"unknown part labels {unknown}" if unknown else f"no node with part label {absent}",
            fix="number the rigid parts without gaps and name every one",
        )
    return part, tuple(names)


def _tissues(grid: "pv.UnstructuredGrid", count: int, names: Sequence[str], what: str) -> AnyArray:
    tissue = np.asarray(grid.cell_data.get("tissue", np.zeros(count)))
    known = tissue.ndim == 1 and np.isin(tissue, np.arange(len(names))).all()
    if not known:
        raise InputError(
            what, expected=f"tissue numbers 0 … {len(names) - 1} ({', '.join(names)})",
            got=f"{tissue[~np.isin(tissue, np.arange(len(names)))].ravel()[0]:g}",
            fix="number the tissues as they are named in field data 'tissue_names'",
        )
    return tissue.astype(np.int16)


def _held(values: AnyArray, what: str) -> BoolArray:
    if values.ndim != 1 or not np.isin(values, (0, 1)).all():
        raise InputError(
            what, expected="0 or 1 for each point as 'fixed'", got="other values", fix="write 1 at each node held",
        )
    return values.astype(bool)


def _read_fixed(path: Path, grid: "pv.UnstructuredGrid") -> BoolArray:
    expected = "a text file of node indices"
    try:
        text = read_text(path, expected=expected).lstrip("\ufeff").replace(",", " ").replace(";", " ")
        indices = np.array(text.split(), dtype=np.int64)
    except ValueError as error:
        raise InputError(
            str(path), expected=expected, got=repr(str(error).rpartition(": ")[2].strip("'")[:40]),
            fix="write one integer a line",
        ) from error
    if len(indices) > 2 and np.isin(indices, (0, 1)).all():
        raise InputError(
            str(path), expected=expected, got=f"{len(indices)} numbers that are 0 or 1, a mask",
            fix="write the indices of the nodes that are held, or give the mask as point data 'fixed'",
        )
    in_soft = _SOFT_INDEX in grid.point_data
    index = np.asarray(grid.point_data[_SOFT_INDEX if in_soft else ORIGINAL]) if (
        in_soft or ORIGINAL in grid.point_data) else np.arange(grid.n_points)
    known = np.isin(indices, index[index >= 0])
    if not known.all():
        from_one = bool(np.isin(indices - 1, index[index >= 0]).all())
        raise InputError(
            str(path), expected=f"indices of {'soft nodes' if in_soft else 'nodes'} up to {index.max()}",
            got=f"{indices[~known][0]}",
            fix="count from 0: these count from 1" if from_one else "use the list that belongs to this mesh",
        )
    held: BoolArray = np.isin(index, indices) & (index >= 0)
    return held
