"""Runs CGAL Mesh_3 in a process of its own: ``python cgal_worker.py FOLDER PARENT``, the number of its parent.

A failed assertion inside CGAL ends its process, which must not be the caller's. The wheels' Mesh_3 is parallel and
its result depends on how threads interleave: bound to one processor it is the same every time.

FOLDER holds ``domain.off``, ``seeds.txt`` (points on the surfaces to begin with, each with
its weight and dimension) and ``parameters.json``; the result
is written there as ``cells.mesh`` (Medit). Exit code 3: the surfaces are open or not manifold.
"""

import json
import os
import sys
from pathlib import Path

NOT_CLOSED = 3


def main(folder: Path) -> int:
    """Mesh the domain in `folder`."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    from CGAL import CGAL_Mesh_3 as mesh_3
    from CGAL.CGAL_Kernel import Point_3, Weighted_point_3
    from CGAL.CGAL_Polyhedron_3 import Polyhedron_3

    settings = json.loads((folder / "parameters.json").read_text())
    polyhedron = Polyhedron_3(str(folder / "domain.off"))
    if not polyhedron.size_of_facets() or not polyhedron.is_closed():
        return NOT_CLOSED
    domain = mesh_3.Polyhedral_mesh_domain_3(polyhedron)
    criteria = mesh_3.Default_mesh_criteria()
    criteria.cell_radius_edge_ratio(settings["cell_ratio"])
    criteria.cell_size(settings["cell_size"])
    criteria.facet_angle(settings["facet_angle"])
    criteria.facet_size(settings["facet_size"])
    criteria.facet_distance(settings["facet_approximation"])
    parameters = mesh_3.Mesh_3_parameters()
    if settings["perturb_seconds"] > 0.0:
        parameters.set_perturb(settings["perturb_seconds"], settings["sliver_bound"])
    else:
        parameters.no_perturb()
    if settings["exude_seconds"] > 0.0:
        parameters.set_exude(settings["exude_seconds"], settings["sliver_bound"])
    else:
        parameters.no_exude()
    # CGAL itself begins with a few random points and may miss a small cavity altogether; these hit every surface.
    complex_ = mesh_3.Mesh_3_Complex_3_in_triangulation_3()
    on_surface = domain.index_from_surface_index(mesh_3.Mesh_3_Surface_index(0, 1))
    for line in (folder / "seeds.txt").read_text().splitlines():
        x, y, z, weight, dimension = line.split()
        point = Point_3(float(x), float(y), float(z))
        vertex = complex_.triangulation().insert(Weighted_point_3(point, float(weight)))
        complex_.set_dimension(vertex, int(dimension))
        complex_.set_index(vertex, on_surface)
    mesh_3.refine_mesh_3(complex_, domain, criteria, parameters)
    complex_.output_to_medit(str(folder / "cells.mesh"))
    return 0


if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).parents[3])  # of the package, not of this folder, whose modules have common names
    from mixpinn.base.child_process import end_with_parent

    end_with_parent(int(sys.argv[2]))
    sys.stdout.flush()
    code = main(Path(sys.argv[1]))
    # Threads of the bindings may outlive the interpreter's shutdown; the result is on disk, so leave at once.
    os._exit(code)
