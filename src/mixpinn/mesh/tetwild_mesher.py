"""fTetWild (Hu et al. 2020): robust to defective surfaces, under a licence without copyleft."""

import contextlib
import tempfile
from dataclasses import dataclass

import numpy as np

from mixpinn.base.arrays import FloatArray, Int32Array
from mixpinn.mesh.mesher import Sizing, tidy
from mixpinn.mesh.surface import DomainSurfaces, Surface

_FACET_AREA = 50.0
"""Mean area of a surface triangle handed to fTetWild, in units of the approximation squared: the body."""
_RIGID_FACET_AREA = 6.0
"""The same for rigid parts, whose surfaces curve more."""


@dataclass(frozen=True)
class TetwildMesher:
    """fTetWild on the decimated surfaces of body and cavities.

    It knows an edge length and an envelope instead of CGAL's criteria: they are set to the facet size and the facet
    approximation, which gives about as many points on the rigid parts and more in the soft tissue.

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

    def fill(self, surfaces: DomainSurfaces, sizing: Sizing) -> tuple[FloatArray, Int32Array]:
        """Points [mm] (n, 3) and positively oriented cells (m, 4) of the soft tissue.

        Raises:
            InputError: the surfaces enclose nothing.
        """
        import pytetwild

        unit = sizing.facet_approximation**2
        coarse = DomainSurfaces(
            decimated(surfaces.body, _FACET_AREA * unit),
            tuple(decimated(surface, _RIGID_FACET_AREA * unit) for surface in surfaces.rigid),
        )
        points, triangles = coarse.domain()
        diagonal = float(np.linalg.norm(np.ptp(points, axis=0)))
        # fTetWild leaves a debugging surface in the current folder.
        with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
            nodes, cells = pytetwild.tetrahedralize(
                points, triangles.astype(np.int32), edge_length_abs=min(sizing.facet_size, 0.9 * diagonal),
                epsilon=sizing.facet_approximation / diagonal, stop_energy=self.stop_energy, simplify=self.simplify,
                num_threads=self.threads, vtk_ordering=True,
            )
        return tidy(nodes, cells, what=surfaces.body.name)


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
