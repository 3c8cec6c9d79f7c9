"""Reading a grid of cells with pyvista or meshio: what a process of its own runs, see `mixpinn.base.reader_process`."""

import contextlib
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mixpinn.base.arrays import AnyArray
from mixpinn.records.strict_vtk import strict_vtk

_VTK = {".vtu", ".vtk", ".pvtu", ".vtm", ".e", ".exo"}
_GROUPS = ("point_data", "cell_data", "field_data")


def grid_arrays(path: Path) -> tuple[dict[str, AnyArray], dict[str, Any]]:
    """Points, cells and data of a file, whatever of them there is.

    Returns:
        ``points``, ``connectivity``, ``offsets`` and ``types`` as VTK keeps them, and ``GROUP.I`` for the I-th data of
        a group; plain values: for each group the names of its data in order, and texts of the field data by name.

    Raises:
        ValueError: no grid.
    """
    import pyvista as pv

    suffix = path.suffix.lower()
    with strict_vtk():
        grid = pv.read(path, force_ext=suffix) if suffix in _VTK else pv.from_meshio(_through_meshio(path))
        if isinstance(grid, pv.MultiBlock):
            grid = grid.combine(merge_points=False)
    if not isinstance(grid, pv.UnstructuredGrid) or not grid.n_cells:
        raise ValueError(f"a damaged file or no cells ({type(grid).__name__})")
    arrays = {
        "points": np.asarray(grid.points), "connectivity": np.asarray(grid.cell_connectivity),
        "offsets": np.asarray(grid.cell_offsets), "types": np.asarray(grid.celltypes),
    }
    about: dict[str, Any] = {"text": {}}
    for group in _GROUPS:
        about[group] = []
        for name, values in _numbers(getattr(grid, group), about["text"]).items():
            arrays[f"{group}.{len(about[group])}"] = values
            about[group].append(name)
    return arrays, about


def _numbers(data: Mapping[str, Any], text: dict[str, list[str]]) -> dict[str, AnyArray]:
    """The arrays of numbers in `data`; those of text are put into `text`."""
    found = {}
    for name in data.keys():  # noqa: SIM118 (not a mapping)
        values = np.asarray(data[name])
        if values.dtype.kind in "biuf":
            found[str(name)] = np.ascontiguousarray(values)
        elif values.dtype.kind in "US":
            text[str(name)] = [str(value) for value in values.ravel()]
    return found


def _through_meshio(path: Path) -> Any:
    import meshio

    try:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            mesh = meshio.read(path)
    except SystemExit as error:  # its way to say that a file cannot be read
        raise ValueError(f"not a file of type {path.suffix.lower()}") from error
    # Tags of the surfaces round each of Gmsh's volumes, which pyvista would take for indices of cells.
    mesh.cell_sets.pop("gmsh:bounding_entities", None)
    return mesh
