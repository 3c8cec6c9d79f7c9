"""Prediction: the deformation that a model answers with."""

from dataclasses import dataclass
from pathlib import Path

import pyvista as pv

from mixpinn.base.arrays import AnyArray
from mixpinn.base.errors import InputError
from mixpinn.records.tissue_mesh import TissueMesh
from mixpinn.records.vtk_file import write_vtk


@dataclass(frozen=True, eq=False)
class Prediction:
    """A predicted displacement field.

    Attributes:
        mesh: the mesh that it belongs to.
        displacement: of every mesh node [mm], shape (n, 3).
        reference: the displacement that was to be predicted, if known [mm], shape (n, 3).
        model: name of the model.
    """

    mesh: TissueMesh
    displacement: AnyArray
    reference: AnyArray | None = None
    model: str = ""

    def grid(self) -> pv.UnstructuredGrid:
        """The deformed mesh with point data ``displacement`` and, where the reference is known, ``error`` [mm]."""
        grid = self.mesh.grid(self.displacement)
        if self.reference is not None:
            grid.point_data["reference"] = self.reference
            grid.point_data["error"] = ((self.displacement - self.reference) ** 2).sum(axis=1) ** 0.5
        return grid

    def save(self, path: Path | str) -> None:
        """Write the deformed mesh: ``.vtu`` with all fields, or the surface as ``.stl`` or ``.ply``.

        Raises:
            InputError: another suffix.
        """
        path = Path(path)
        if path.suffix not in {".vtu", ".stl", ".ply"}:
            raise InputError(
                str(path), expected=".vtu, .stl or .ply", got=path.suffix or "no suffix", fix="rename the output",
            )
        grid = self.grid()
        write_vtk(path, grid if path.suffix == ".vtu" else grid.extract_surface(algorithm="dataset_surface"))
