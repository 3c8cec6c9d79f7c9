"""Writing VTK's data sets so that a full disk is an ordinary error."""

import errno
import os
from pathlib import Path

import pyvista as pv
from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

from mixpinn.base.files import atomic_path


def write_vtk(path: Path | str, dataset: pv.UnstructuredGrid | pv.PolyData) -> None:
    """Write a grid as ``.vtu``, or a surface as ``.stl``, ``.ply`` or ``.vtp``, atomically.

    Raises:
        InputError: the folder cannot be written, or the disk is full.
    """
    with atomic_path(path) as temporary, pv.vtk_verbosity("off"):
        if isinstance(dataset, pv.UnstructuredGrid):
            temporary.write_text(_xml(dataset), encoding="ascii")
            return
        dataset.save(temporary)
        # VTK's PLY writer passes over errors: twelve bytes a point and thirteen a triangle must be there.
        if temporary.suffix == ".ply" and temporary.stat().st_size < 12 * dataset.n_points + 13 * dataset.n_cells:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))


def _xml(grid: pv.UnstructuredGrid) -> str:
    """The ``.vtu`` in memory: VTK's own writing of this file ends the whole process where the disk is full."""
    writer = vtkXMLUnstructuredGridWriter()
    writer.SetInputData(grid)
    writer.SetDataModeToBinary()
    writer.SetWriteToOutputString(True)
    writer.Write()
    text: str = writer.GetOutputString()
    return text
