"""Writing VTK's data sets so that a full disk is an ordinary error."""

import errno
import os
from pathlib import Path
from typing import TYPE_CHECKING

from vtkmodules.vtkCommonDataModel import vtkUnstructuredGrid

from mixpinn.base.files import atomic_path
from mixpinn.records.vtu import silence, vtu_text

if TYPE_CHECKING:
    import pyvista as pv


def write_vtk(path: Path | str, dataset: "vtkUnstructuredGrid | pv.PolyData") -> None:
    """Write a grid as ``.vtu``, or a surface as ``.stl``, ``.ply`` or ``.vtp``, atomically.

    Raises:
        InputError: the folder cannot be written, or the disk is full.
    """
    with atomic_path(path) as temporary, silence():
        if isinstance(dataset, vtkUnstructuredGrid):
            temporary.write_text(vtu_text(dataset), encoding="ascii")
            return
        dataset.save(temporary)
        # VTK's PLY writer passes over errors: twelve bytes a point and thirteen a triangle must be there.
        if temporary.suffix == ".ply" and temporary.stat().st_size < 12 * dataset.n_points + 13 * dataset.n_cells:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
