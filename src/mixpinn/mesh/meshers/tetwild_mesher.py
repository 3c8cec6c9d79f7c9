"""fTetWild (Hu et al. 2020): robust to defective surfaces, under a licence without copyleft."""

import contextlib
from dataclasses import dataclass

import numpy as np

from mixpinn.base.arrays import AnyArray, FloatArray, Int32Array
from mixpinn.base.scratch_folder import scratch_folder
from mixpinn.mesh.cells.orientation import orient_cells
from mixpinn.mesh.meshers.grading import Grading, SizingField
from mixpinn.mesh.meshers.mesher import Sizing, tidy
from mixpinn.mesh.surfaces.surface import DomainSurfaces, Surface

_FACET_AREA = 50.0
"""Mean area of a surface triangle handed to fTetWild, in units of the approximation squared: the body."""
_RIGID_FACET_AREA = 6.0
"""The same for rigid parts, whose surfaces curve more."""


_BACKGROUND = 12.0
"""Edge of the grid that carries the edge lengths of a graded mesh [mm]."""


@dataclass(frozen=True)
class TetwildMesher:
    """fTetWild on the decimated surfaces of body and cavities.

    It knows an edge length and an envelope instead of CGAL's criteria: they are set to the facet size and the facet
    approximation, which gives about as many points on the rigid parts and more in the soft tissue. A graded mesh gives
    it the edge length at every place.

    Attributes:
        stop_energy: the optimisation stops when the worst cell's conformal AMIPS energy falls below this; 3 is the
            regular tetrahedron.
        simplify: let fTetWild simplify its input once more: slower, and only of use for defective surfaces.
        threads: threads of its simplification; with more than one, the result may differ from run to run.
    """

    stop_energy: float = 10.0
    simplify: bool = False
    threads: int = 1
    name: str = "tetwild"

    def fill(self, surfaces: DomainSurfaces, sizing: Sizing | Grading) -> tuple[FloatArray, Int32Array]:
        """Points [mm] (n, 3) and positively oriented cells (m, 4) of the soft tissue.

        Raises:
            InputError: the surfaces enclose nothing.
        """
        import pytetwild

        envelope = sizing.distance if isinstance(sizing, Grading) else sizing.facet_approximation
        edge = sizing.elsewhere if isinstance(sizing, Grading) else sizing.facet_size
        unit = envelope**2
        coarse = DomainSurfaces(
            decimated(surfaces.body, _FACET_AREA * unit),
            tuple(decimated(surface, _RIGID_FACET_AREA * unit) for surface in surfaces.rigid),
        )
        points, triangles = coarse.domain()
        diagonal = float(np.linalg.norm(np.ptp(points, axis=0)))
        background = _background(surfaces, sizing) if isinstance(sizing, Grading) else {}
        # fTetWild leaves a debugging surface in the current folder.
        with scratch_folder() as folder, contextlib.chdir(folder):
            nodes, cells = pytetwild.tetrahedralize(
                points, triangles.astype(np.int32), edge_length_abs=min(edge, 0.9 * diagonal),
                epsilon=envelope / diagonal, stop_energy=self.stop_energy, simplify=self.simplify,
                num_threads=self.threads, vtk_ordering=True, **background,
            )
        return tidy(nodes, cells, what=surfaces.body.name)


def _background(surfaces: DomainSurfaces, grading: Grading) -> dict[str, AnyArray]:
    """The edge lengths of `grading` on a coarse tetrahedral grid over the body, as fTetWild takes them."""
    import pyvista as pv

    low, high = surfaces.body.points.min(axis=0), surfaces.body.points.max(axis=0)
    counts = np.maximum(np.ceil((high - low) / _BACKGROUND).astype(int), 1) + 2
    axes = [np.linspace(a - _BACKGROUND, b + _BACKGROUND, n + 1) for a, b, n in zip(low, high, counts, strict=True)]
    grid = pv.RectilinearGrid(*axes).to_tetrahedra(5)
    points, cells = np.asarray(grid.points, dtype=np.float64), np.asarray(grid.cells_dict[pv.CellType.TETRA])
    return {
        "bg_vertices": points, "bg_tets": orient_cells(points, cells),
        "bg_values": SizingField(surfaces, grading)(points),
    }


def decimated(surface: Surface, area: float) -> Surface:
    """`surface` with triangles of about `area` [mm²] each by quadric error decimation; unchanged if larger."""
    corners = surface.points[surface.triangles]
    total = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum()
    wanted = max(total / area, 100.0)
    if wanted >= len(surface.triangles):
        return surface
    coarse = surface.polydata().decimate(1.0 - wanted / len(surface.triangles), volume_preservation=True)
    return Surface(
        surface.name, np.asarray(coarse.points, dtype=np.float64), np.asarray(coarse.regular_faces, dtype=np.int64),
    )
