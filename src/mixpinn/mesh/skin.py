"""The probed surface: where the back's skin is, and where to set the probe on it."""

import numpy as np

from mixpinn.base.arrays import FloatArray
from mixpinn.base.errors import InputError
from mixpinn.records.tissue_mesh import TissueMesh


def skin_height(mesh: TissueMesh, xz: FloatArray) -> FloatArray:
    """Largest y of the skin on the line parallel to y through each of `xz` [mm] (p, 2); NaN beside it; shape (p,)."""
    xz = np.asarray(xz, dtype=np.float64)
    a, b, c = np.moveaxis(mesh.points[mesh.skin_faces], 1, 0)
    height = np.full(len(xz), np.nan)
    # Twice the signed area of each triangle seen along y; lines parallel to a triangle (the caps) never meet it.
    area = _cross(b - a, c - a)
    seen = np.abs(area) > 1e-12
    a, b, c, area = a[seen], b[seen], c[seen], area[seen]
    for i, (x, z) in enumerate(xz):
        at = np.array([x, 0.0, z])
        weight_b, weight_c = _cross(at - a, c - a) / area, _cross(b - a, at - a) / area
        inside = (weight_b >= -1e-9) & (weight_c >= -1e-9) & (weight_b + weight_c <= 1.0 + 1e-9)
        if inside.any():
            y = a[:, 1] + weight_b * (b - a)[:, 1] + weight_c * (c - a)[:, 1]
            height[i] = y[inside].max()
    return height


def probe_positions(mesh: TissueMesh, *, spacing: float = 10.0) -> FloatArray:
    """Tip positions on the back over the extent of the rigid parts [mm], shape (p, 3).

    The grid is that of the multiples of `spacing` within the rigid parts' extent in x and z, row by row from cranial
    to caudal, x ascending; y is the skin's. Grid points beside the skin are left out.

    Raises:
        InputError: the mesh has no rigid parts, or they are smaller than the spacing.
    """
    rigid = mesh.points[mesh.part > 0]
    if not len(rigid) or not spacing > 0.0:
        raise InputError(
            "probe positions", expected="rigid parts and a positive spacing",
            got=f"{len(rigid)} rigid nodes, {spacing:g} mm", fix="list the positions yourself",
        )
    low, high = np.ceil(rigid.min(axis=0) / spacing), np.floor(rigid.max(axis=0) / spacing)
    x, z = (spacing * np.arange(low[axis], high[axis] + 1) for axis in (0, 2))
    grid = np.array([(u, v) for v in z for u in x]).reshape(-1, 2)
    height = skin_height(mesh, grid)
    positions = np.column_stack([grid[:, 0], height, grid[:, 1]])[np.isfinite(height)]
    if not len(positions):
        raise InputError(
            "probe positions", expected="a grid over the rigid parts", got="no position on the skin",
            fix="choose a smaller spacing",
        )
    return positions


def _cross(u: FloatArray, v: FloatArray) -> FloatArray:
    area: FloatArray = u[..., 0] * v[..., 2] - u[..., 2] * v[..., 0]
    return area
