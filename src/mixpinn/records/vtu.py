"""Tetrahedra in VTK's ``.vtu`` with arrays on points, cells and the whole: written by VTK, read without it.

PyVista does the same and much more; its import takes ten times as long as a reader that needs no pictures.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
from vtkmodules.vtkCommonCore import vtkLogger, vtkObject, vtkPoints, vtkStringArray
from vtkmodules.vtkCommonDataModel import VTK_QUADRATIC_TETRA, VTK_TETRA, vtkCellArray, vtkUnstructuredGrid
from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

from mixpinn.base.arrays import AnyArray, FloatArray
from mixpinn.base.reader_process import read_apart
from mixpinn.records.grid_file import grid_arrays
from mixpinn.records.vtu_parse import ParsedGrid, UnknownEncodingError, parse_vtu

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
            ValueError: damaged, or without tetrahedra.
        """
        path = Path(path)
        try:
            grid = parse_vtu(path.read_bytes())
        except UnknownEncodingError:
            grid = _read_by_vtk(path)
        kinds = grid.types
        n_corners = 10 if (kinds == VTK_QUADRATIC_TETRA).any() else 4
        tetra = np.flatnonzero(kinds == _KINDS[n_corners])
        ends = grid.offsets.astype(np.int64)
        starts = np.concatenate([[0], ends])[tetra]
        if not len(tetra) or (ends[tetra] - starts != n_corners).any():
            raise ValueError("no tetrahedra" if not len(tetra) else f"tetrahedra without {n_corners} points")
        return TetraGrid(
            grid.points.astype(np.float64), grid.connectivity[starts[:, None] + np.arange(n_corners)].astype(np.int64),
            grid.point_data, {name: values[tetra] for name, values in grid.cell_data.items()}, grid.field_data,
        )


def _read_by_vtk(path: Path) -> ParsedGrid:
    """What VTK makes of a file in another encoding, in a process of its own."""
    arrays, about = read_apart(grid_arrays, path)
    data: dict[str, dict[str, Any]] = {
        group: {name: arrays[f"{group}.{index}"] for index, name in enumerate(about[group])}
        for group in ("point_data", "cell_data", "field_data")
    }
    return ParsedGrid(
        arrays["points"], arrays["connectivity"], arrays["offsets"][1:], arrays["types"], data["point_data"],
        data["cell_data"], data["field_data"] | about["text"],
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

