"""Small meshes and label maps that several tests build on."""

import numpy as np

from mixpinn.records import LabelMap, TissueMesh
from mixpinn.records.label_map import SCANNER_TO_WORLD
from validation.kuhn import grid_points, kuhn_cells


def box_mesh(n=(4, 4, 4), *, cavity=None, spacing=10.0):
    """Cubes of edge `spacing` cut into six tetrahedra each; the cubes in `cavity` (a slice) are left out, as part 1."""
    points = spacing * (grid_points(*(np.arange(k + 1) for k in n)) - np.array(n) / 2.0)
    cells = kuhn_cells(n).reshape(*n, 6, 4)
    keep = np.ones(n, dtype=bool)
    part = np.zeros(len(points), dtype=np.int16)
    names = ()
    if cavity is not None:
        keep[cavity] = False
        part[np.unique(cells[~keep])] = 1
        names = ("block",)
    cells = cells[keep].reshape(-1, 4)
    return TissueMesh(
        points, cells, part, np.zeros(len(points), dtype=bool), names, np.zeros(len(cells), dtype=np.int16),
    )


def ball_label_map(*, voxel=2.0, radius=40.0, centres=((0.0, 0.0, 0.0),), ball=12.0, spacing=None):
    """A ball of tissue round the origin with rigid balls in it; `spacing` makes the voxels anisotropic."""
    spacing = np.full(3, voxel) if spacing is None else np.asarray(spacing)
    half = np.ceil((radius + 6.0) / spacing)
    axes = [np.arange(-h, h + 1) * s for h, s in zip(half, spacing, strict=True)]
    where = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    labels = (np.linalg.norm(where, axis=-1) <= radius).astype(np.uint8)
    for k, centre in enumerate(centres):
        labels[np.linalg.norm(where - np.array(centre), axis=-1) <= ball] = 2 + k
    affine = np.diag([*spacing, 1.0])
    affine[:3, 3] = -half * spacing
    names = tuple(f"ball {k}" for k in range(1, len(centres) + 1))
    return LabelMap(labels, affine, np.linalg.inv(SCANNER_TO_WORLD), ("body",), names)
