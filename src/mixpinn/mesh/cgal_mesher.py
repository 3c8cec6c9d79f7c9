"""Delaunay refinement by CGAL Mesh_3: the mesher and the criteria of the paper. Optional, GPL."""

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mixpinn.base.arrays import FloatArray, Int32Array, IntArray
from mixpinn.base.errors import InputError
from mixpinn.mesh.mesher import Sizing, has_cgal, tidy
from mixpinn.mesh.surface import DomainSurfaces


@dataclass(frozen=True)
class CgalMesher:
    """CGAL Mesh_3 on the polyhedral domain between the body's surface and the cavities.

    Refinement to the criteria (Boissonnat & Oudot 2005; Rineau & Yvinec 2007) leaves slivers: perturbation of their
    nodes and exudation by weights (Cheng et al. 2000) remove them. The sharp rims of the caps are approximated, not
    protected, as in the paper's mesh.

    Attributes:
        perturb_seconds: time limit of the perturbation [s]; 0 leaves it out.
        exude_seconds: time limit of the exudation [s]; 0 leaves it out.
        sliver_bound: dihedral angle at which both stop [degree].
    """

    perturb_seconds: float = 15.0
    exude_seconds: float = 15.0
    sliver_bound: float = 12.0
    name: str = "cgal"

    def fill(self, surfaces: DomainSurfaces, sizing: Sizing) -> tuple[FloatArray, Int32Array]:
        """Points [mm] (n, 3) and positively oriented cells (m, 4) of the soft tissue.

        Raises:
            InputError: the bindings are not installed, or the surfaces are open or not manifold.
        """
        if not has_cgal():
            raise InputError(
                "mesher cgal", expected="the package 'cgal' (Python 3.12 or older)", got="none installed",
                fix="pip install 'mixpinn[cgal]' or choose the mesher tetwild",
            )
        from CGAL import CGAL_Mesh_3 as mesh_3
        from CGAL.CGAL_Polyhedron_3 import Polyhedron_3

        what = surfaces.body.name
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "domain.off"
            _write_off(file, *surfaces.domain())
            polyhedron = Polyhedron_3(str(file))
            if not polyhedron.size_of_facets() or not polyhedron.is_closed():
                raise InputError(
                    what, expected="closed manifold surfaces", got="open or branching ones",
                    fix="close the surfaces, or choose the mesher tetwild",
                )
            criteria = mesh_3.Default_mesh_criteria()
            criteria.cell_radius_edge_ratio(sizing.cell_ratio).cell_size(sizing.cell_size)
            criteria.facet_angle(sizing.facet_angle).facet_size(sizing.facet_size)
            criteria.facet_distance(sizing.facet_approximation)
            parameters = mesh_3.Mesh_3_parameters()
            if self.perturb_seconds > 0.0:
                parameters.set_perturb(self.perturb_seconds, self.sliver_bound)
            else:
                parameters.no_perturb()
            if self.exude_seconds > 0.0:
                parameters.set_exude(self.exude_seconds, self.sliver_bound)
            else:
                parameters.no_exude()
            complex_ = mesh_3.make_mesh_3(mesh_3.Polyhedral_mesh_domain_3(polyhedron), criteria, parameters)
            if not complex_.number_of_cells():
                return tidy(np.zeros((0, 3)), np.zeros((0, 4), dtype=np.int64), what=what)
            medit = Path(folder) / "cells.mesh"
            complex_.output_to_medit(str(medit))
            return tidy(*_read_medit(medit), what=what)


def _write_off(path: Path, points: FloatArray, triangles: IntArray) -> None:
    with open(path, "w") as file:
        file.write(f"OFF\n{len(points)} {len(triangles)} 0\n")
        file.write("%.6f %.6f %.6f\n" * len(points) % tuple(points.ravel().tolist()))
        file.write("3 %d %d %d\n" * len(triangles) % tuple(triangles.ravel().tolist()))


def _read_medit(path: Path) -> tuple[FloatArray, IntArray]:
    """Vertices and tetrahedra of a Medit text file; each line ends with a reference number, ids start at 1."""
    lines = path.read_text().split("\n")
    start, ids = lines.index("Vertices") + 2, lines.index("Tetrahedra") + 2
    n_points, n_cells = int(lines[start - 1]), int(lines[ids - 1])
    points = np.array(" ".join(lines[start:start + n_points]).split(), dtype=np.float64).reshape(n_points, 4)[:, :3]
    cells = np.array(" ".join(lines[ids:ids + n_cells]).split(), dtype=np.int64).reshape(n_cells, 5)[:, :4] - 1
    return points, cells
