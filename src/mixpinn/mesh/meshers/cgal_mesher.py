"""Delaunay refinement by CGAL Mesh_3: the mesher and the criteria of the paper. Optional, GPL."""

import os
import subprocess
import sys
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from mixpinn.base.arrays import FloatArray, Int32Array, IntArray
from mixpinn.base.errors import InputError
from mixpinn.base.files import write_json
from mixpinn.base.scratch_folder import scratch_folder
from mixpinn.geometry.farthest_points import distances_between, farthest_first
from mixpinn.mesh.meshers.cgal_worker import NOT_CLOSED
from mixpinn.mesh.meshers.grading import Grading
from mixpinn.mesh.meshers.mesher import Sizing, has_cgal, tidy
from mixpinn.mesh.meshers.scatter import scatter_on_surfaces
from mixpinn.mesh.surfaces.surface import DomainSurfaces

_SEEDS = 20
"""Points on each surface that refinement begins with."""
_FIX = "check the surfaces for holes and self-intersections, or choose the mesher tetwild"


@dataclass(frozen=True)
class CgalMesher:
    """CGAL Mesh_3 on the polyhedral domain between the body's surface and the cavities.

    Refinement to the criteria (Boissonnat & Oudot 2005; Rineau & Yvinec 2007) leaves slivers: perturbation of their
    nodes (Tournois et al. 2009) and exudation by weights (Cheng et al. 2000) remove them. The same surfaces give the
    same mesh on Linux, as long as neither time limit is reached.

    The bindings know constant criteria only. A graded mesh begins with points scattered over the surfaces as the
    grading wants them; refinement then adds points where facets are too far from the surface or cells badly shaped.
    Rims of the caps are protected by balls, without which a right angle takes hundreds of small facets. A mesh of
    constant criteria approximates the rims, as the paper's does.

    Attributes:
        perturb_seconds: time limit of the perturbation [s]; 0 leaves it out.
        exude_seconds: time limit of the exudation [s]; 0 leaves it out.
        sliver_bound: dihedral angle at which both stop [degree].
        timeout: time limit of all of it, after which meshing fails [s].
    """

    perturb_seconds: float = 60.0
    exude_seconds: float = 60.0
    sliver_bound: float = 12.0
    timeout: float = 7200.0
    name: str = "cgal"

    def fill(self, surfaces: DomainSurfaces, sizing: Sizing | Grading) -> tuple[FloatArray, Int32Array]:
        """Points [mm] (n, 3) and positively oriented cells (m, 4) of the soft tissue.

        Raises:
            InputError: the bindings are not installed, the surfaces are open or not manifold, no cell fits them, or the
                time limit is reached.
        """
        if not has_cgal():
            raise InputError(
                "mesher cgal", expected="the package 'cgal' (Python 3.12 or older)", got="none installed",
                fix="pip install 'mixpinn[cgal]' or choose the mesher tetwild",
            )
        what = surfaces.body.name
        with scratch_folder() as folder:
            _write_off(folder / "domain.off", *surfaces.domain())
            np.savetxt(folder / "seeds.txt", _seeds(surfaces, sizing), fmt="%.6f %.6f %.6f %.6f %d")
            write_json(folder / "parameters.json", {**asdict(_criteria(sizing)), **asdict(self)})
            worker = Path(__file__).with_name("cgal_worker.py")
            try:
                run = subprocess.run(
                    [sys.executable, str(worker), str(folder), str(os.getpid())], capture_output=True, text=True,
                    check=False, timeout=self.timeout,
                )
            except subprocess.TimeoutExpired as error:
                raise InputError(
                    what, expected=f"a mesh within {self.timeout:g} s", got="none yet",
                    fix="try again, or choose a larger size, the mesher tetwild, or more time (setting timeout)",
                ) from error
            if run.returncode < 0:
                raise InputError(
                    what, expected="a mesh", got=f"a meshing process that was ended by signal {-run.returncode}",
                    fix="try again; with little memory choose a larger size",
                )
            if run.returncode == NOT_CLOSED:
                raise InputError(what, expected="closed manifold surfaces", got="open or branching ones", fix=_FIX)
            medit = folder / "cells.mesh"
            if run.returncode != 0 or not medit.is_file():
                last = (run.stderr or run.stdout).strip().splitlines()[-1:] or ["no message"]
                raise InputError(
                    what, expected="surfaces that CGAL can mesh", got=f"exit code {run.returncode} ({last[0]})",
                    fix=_FIX,
                )
            return tidy(*_read_medit(medit), what=what)


def _seeds(surfaces: DomainSurfaces, sizing: Sizing | Grading) -> FloatArray:
    """Points that refinement begins with, as `scatter_on_surfaces` gives them."""
    if isinstance(sizing, Grading):
        return scatter_on_surfaces(surfaces, sizing)
    spread = np.concatenate([spread_points(surface.points, _SEEDS) for surface in (surfaces.body, *surfaces.rigid)])
    return np.column_stack([spread, np.zeros(len(spread)), np.full(len(spread), 2.0)])


def _criteria(sizing: Sizing | Grading) -> Sizing:
    """CGAL's criteria; those of a grading bound what its points leave open."""
    if isinstance(sizing, Sizing):
        return sizing
    return Sizing(
        cell_size=1.5 * sizing.elsewhere, facet_angle=sizing.angle, facet_size=1.25 * sizing.elsewhere,
        facet_approximation=sizing.distance,
    )


def spread_points(points: FloatArray, count: int) -> FloatArray:
    """`count` of the points, each as far as possible from those before it; shape (count, 3)."""
    first = int(points[:, 1].argmax())
    return points[farthest_first(distances_between(points), first=first, count=count)]


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
