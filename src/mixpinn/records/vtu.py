"""Tetrahedra in VTK's ``.vtu`` with arrays on points, cells and the whole, by VTK's own reader and writer.

PyVista does the same and much more; its import takes ten times as long as a reader that needs no pictures.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkLogger, vtkObject, vtkPoints, vtkStringArray
from vtkmodules.vtkCommonDataModel import VTK_QUADRATIC_TETRA, VTK_TETRA, vtkCellArray, vtkUnstructuredGrid
from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader, vtkXMLUnstructuredGridWriter

from mixpinn.base.arrays import AnyArray, FloatArray

_KINDS = {4: VTK_TETRA, 10: VTK_QUADRATIC_TETRA}
"""VTK's kind of a tetrahedron by its number of nodes."""


@dataclass(frozen=True, eq=False)
class TetraGrid:
    """Tetrahedra with data; n points, m cells.

    Attributes:
        points: [mm], shape (n, 3).
        cells: shape (m, 4), or (m, 10) for quadratic ones in VTK's order.
        point_data: arrays by name, shapes (n, …).
        cell_data: arrays by name, shapes (m, …).
        field_data: arrays or ASCII texts by name.
    """

    points: FloatArray
    cells: AnyArray
    point_data: Mapping[str, AnyArray] = field(default_factory=dict)
    cell_data: Mapping[str, AnyArray] = field(default_factory=dict)
    field_data: Mapping[str, AnyArray | Sequence[str]] = field(default_factory=dict)

    def vtk(self) -> vtkUnstructuredGrid:
        """The same as VTK's object."""
        corners = self.cells.shape[1]
        points, cells, grid = vtkPoints(), vtkCellArray(), vtkUnstructuredGrid()
        points.SetData(numpy_to_vtk(np.ascontiguousarray(self.points), deep=True))
        cells.SetData(
            numpy_to_vtkIdTypeArray(corners * np.arange(len(self.cells) + 1, dtype=np.int64), deep=True),
            numpy_to_vtkIdTypeArray(np.ascontiguousarray(self.cells, dtype=np.int64).ravel(), deep=True),
        )
        grid.SetPoints(points)
        grid.SetCells(_KINDS[corners], cells)
        for target, arrays in (
            (grid.GetPointData(), self.point_data), (grid.GetCellData(), self.cell_data),
            (grid.GetFieldData(), self.field_data),
        ):
            for name, values in arrays.items():
                target.AddArray(_array(name, values))
        return grid

    @staticmethod
    def read(path: Path | str) -> "TetraGrid":
        """Read a ``.vtu`` of linear or of quadratic tetrahedra; cells of other kinds are left out.

        Raises:
            ValueError: VTK cannot read it.
        """
        reader = vtkXMLUnstructuredGridReader()
        with silence():
            if not reader.CanReadFile(str(path)):
                raise ValueError("not a VTK file of an unstructured grid")
            reader.SetFileName(str(path))
            reader.Update()
        grid = reader.GetOutput()
        if reader.GetErrorCode() or grid is None or not grid.GetNumberOfPoints() or not grid.GetNumberOfCells():
            raise ValueError("damaged, or without points and cells")
        offsets = vtk_to_numpy(grid.GetCells().GetOffsetsArray())
        corners = vtk_to_numpy(grid.GetCells().GetConnectivityArray())
        kinds = vtk_to_numpy(grid.GetCellTypes())
        n_corners = 10 if (kinds == VTK_QUADRATIC_TETRA).any() else 4
        tetra = np.flatnonzero(kinds == _KINDS[n_corners])
        return TetraGrid(
            vtk_to_numpy(grid.GetPoints().GetData()).astype(np.float64),
            corners[offsets[tetra][:, None] + np.arange(n_corners)].astype(np.int64),
            _arrays(grid.GetPointData()), _arrays(grid.GetCellData()), _arrays(grid.GetFieldData()),
        )


def vtu_text(grid: vtkUnstructuredGrid) -> str:
    """The ``.vtu`` in memory: VTK's own writing of this file ends the whole process where the disk is full."""
    writer = vtkXMLUnstructuredGridWriter()
    writer.SetInputData(grid)
    writer.SetDataModeToBinary()
    writer.SetWriteToOutputString(True)
    writer.Write()
    text: str = writer.GetOutputString()
    return text


@contextmanager
def silence() -> Iterator[None]:
    """VTK writes nothing on standard error while this lasts."""
    before = vtkLogger.GetCurrentVerbosityCutoff()
    shown = vtkObject.GetGlobalWarningDisplay()
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    vtkObject.SetGlobalWarningDisplay(0)
    try:
        yield
    finally:
        vtkObject.SetGlobalWarningDisplay(shown)
        vtkLogger.SetStderrVerbosity(before)


def _array(name: str, values: Any) -> Any:
    if isinstance(values, np.ndarray):
        array = numpy_to_vtk(np.ascontiguousarray(values), deep=True)
    else:
        array = vtkStringArray()
        for text in values:
            array.InsertNextValue(text)
    array.SetName(name)
    return array


def _arrays(data: Any) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for index in range(data.GetNumberOfArrays()):
        array = data.GetAbstractArray(index)
        if isinstance(array, vtkStringArray):
            found[array.GetName()] = [array.GetValue(i) for i in range(array.GetNumberOfValues())]
        else:
            found[array.GetName()] = vtk_to_numpy(array)
    return found
