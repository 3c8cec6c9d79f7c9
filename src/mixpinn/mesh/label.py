"""What is what in a mesh: the part of each node, the tissue of each cell, the fixed nodes, cells between parts."""

import numpy as np

from mixpinn.base.arrays import AnyArray, BoolArray, FloatArray
from mixpinn.records.label_map import LabelMap
from mixpinn.records.tissue_mesh import TissueMesh

FIXED_DEPTH = 30.0
"""Skin nodes within this distance of the most anterior point are fixed [mm]."""
CAP_MARGIN = 1.0
"""Nodes closer than this to a cap of the crop are not fixed [mm]."""


def fixed_nodes(mesh: TissueMesh) -> BoolArray:
    """Nodes that the protocol holds in place, shape (n,).

    These are the soft skin nodes less than 30 mm behind the most anterior point (smallest y) and more than 1 mm from
    both caps of the crop (smallest and largest z).
    """
    points = mesh.points
    y, z = points[:, 1], points[:, 2]
    skin = np.zeros(mesh.n_points, dtype=bool)
    skin[mesh.skin_faces] = True
    anterior = y < y.min() + FIXED_DEPTH
    off_caps = (z > z.min() + CAP_MARGIN) & (z < z.max() - CAP_MARGIN)
    return skin & anterior & off_caps & (mesh.part == 0)
