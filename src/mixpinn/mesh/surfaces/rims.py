"""Rims: where the flat caps of the crop meet the skin, which a mesh should follow edge by edge."""

import numpy as np
from scipy.spatial import cKDTree

from mixpinn.base.arrays import FloatArray
from mixpinn.mesh.surfaces.surface import Surface

_FLAT = 1e-3
"""A triangle lies in the plane of a cap if its corners do to this distance [mm]."""
_CAP_SHARE = 0.5
"""The share of the cross-section that must be flat for the end to count as a cap."""


def cap_rims(surface: Surface, *, spacing: float) -> tuple[FloatArray, ...]:
    """Closed polylines [mm] (p, 3) along the rims of the caps at both ends of z, points about `spacing` [mm] apart.

    Marching cubes bevels a rim by about a voxel, so that the outline is taken two triangles' edges before the end and
    moved into the cap's plane. An end that is not flat has no rim, and a loop that comes close to itself or is too
    short for six points is left out: a mesher approximates it.
    """
    corners = surface.points[surface.triangles]
    edge = float(np.median(np.linalg.norm(corners[:, 0] - corners[:, 1], axis=1)))
    height = float(np.ptp(surface.points[:, 2]))
    inset = min(2.0 * edge, 6.0, 0.1 * height)
    loops = []
    for end, inward in ((float(surface.points[:, 2].min()), 1.0), (float(surface.points[:, 2].max()), -1.0)):
        flat = (np.abs(corners[:, :, 2] - end) < _FLAT).all(axis=1)
        a, b = (corners[flat, k, :2] - corners[flat, 0, :2] for k in (1, 2))
        capped = 0.5 * np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()
        outlines = _outlines(surface, end + inward * inset)
        if capped < _CAP_SHARE * abs(sum(_area(outline) for outline in outlines)) or not capped:
            continue
        for outline in outlines:
            outline[:, 2] = end
            loops.append(_resampled(outline, spacing))
    return tuple(loop for k, loop in enumerate(loops) if _stands_clear(k, loops, spacing))


def _outlines(surface: Surface, z: float) -> list[FloatArray]:
    """Closed loops [mm] in which the plane z cuts the surface."""
    cut = surface.polydata().slice(normal=(0.0, 0.0, 1.0), origin=(0.0, 0.0, z)).strip(join=True)
    points, entries, loops, at = np.asarray(cut.points, dtype=np.float64), np.asarray(cut.lines), [], 0
    while at < len(entries):
        ids = entries[at + 1:at + 1 + entries[at]]
        if len(ids) > 3 and ids[0] == ids[-1]:
            loops.append(points[ids[:-1]].copy())
        at += int(entries[at]) + 1
    return loops


def _area(loop: FloatArray) -> float:
    x, y = loop[:, 0], loop[:, 1]
    return 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))


def _resampled(loop: FloatArray, spacing: float) -> FloatArray:
    closed = np.concatenate([loop, loop[:1]])
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    count = round(along[-1] / spacing)
    at = np.arange(count) * along[-1] / max(count, 1)
    return np.column_stack([np.interp(at, along, closed[:, axis]) for axis in range(3)])


def _stands_clear(k: int, loops: list[FloatArray], spacing: float) -> bool:
    """Whether no point of loop k but its two neighbours comes closer than 1.3 `spacing`."""
    if len(loops[k]) < 6:
        return False
    tree = cKDTree(np.concatenate(loops))
    return all(len(near) <= 3 for near in tree.query_ball_point(loops[k], 1.3 * spacing))
