"""The same anatomy with a finer surface, for the error of the facets."""

from dataclasses import replace
from pathlib import Path

from mixpinn.mesh.meshers.grading import Grading
from mixpinn.records import TissueMesh
from mixpinn.records.label_map import LabelMap
from mixpinn.stages.mesh import MeshConfig, load_mesh, make_mesh, open_source

CLOSER = 0.5
"""Distance of the finer facets from the surface, relative to that of the default mesh's.

Cells stay as they are where the surface does not bend, so that it is the facets that are compared.
"""


def finer_facets(source: Path | str, *, out: Path | str) -> TissueMesh:
    """A mesh with finer facets: that of `source`, or of the label map there, which is meshed into `out`.

    The facet of a smooth surface is off by the square of its edge.

    Args:
        source: folder of `mixpinn anatomy`, or a mesh (``.vtu``, or folder of `mixpinn mesh`) of the same anatomy.
        out: run directory of the meshing; a finished one is read.

    Raises:
        InputError: neither of them, or a damaged one.
    """
    opened = open_source(source) if not (Path(source) / "mesh.vtu").is_file() else source
    if not isinstance(opened, LabelMap):
        return load_mesh(opened)
    finer = replace(Grading(), distance=CLOSER * Grading().distance)
    return make_mesh(opened, MeshConfig(grading=finer, picture=False), out=out).mesh
