"""Points scattered over surfaces at a distance that varies from place to place."""

import numba
import numpy as np
from scipy.spatial import cKDTree

from mixpinn.base.arrays import BoolArray, FloatArray, IntArray
from mixpinn.mesh.meshers.grading import Grading, SizingField, surface_points
from mixpinn.mesh.surfaces.rims import cap_rims
from mixpinn.mesh.surfaces.surface import DomainSurfaces

_RADIUS = 0.8
"""Least distance between points over the edge length that comes of it: triangles between them have edges about 1.25
times as long as their least distance."""
_BALL = 0.6
"""Radius of the ball round a point of a rim over the points' distance: neighbours overlap, second neighbours do not."""
_SPACING = 2.0
"""Distance between the candidates [mm]."""
_SEED = 0


def scatter_on_surfaces(surfaces: DomainSurfaces, grading: Grading) -> FloatArray:
    """Points on all surfaces as `grading` wants them, shape (p, 5): x, y, z [mm], weight [mm²], dimension.

    Points of the rims have the weight of a protecting ball and dimension 1, all others no weight and dimension 2.
    """
    field = SizingField(surfaces, grading)
    generator = np.random.default_rng(_SEED)
    rims = cap_rims(surfaces.body, spacing=grading.rim)
    rim = np.concatenate([*rims, np.zeros((0, 3))])
    steps = [np.linalg.norm(loop - np.roll(loop, 1, axis=0), axis=1).max() for loop in rims]
    radius = np.repeat(steps, [len(loop) for loop in rims]) if rims else np.zeros(0)
    parts = [np.column_stack([rim, (_BALL * radius) ** 2, np.ones(len(rim))])]
    body = surface_points(surfaces.body, _SPACING)
    length = field(body)
    if len(rim):
        to_rim, _ = cKDTree(rim).query(body)
        length = np.minimum(length, grading.rim + grading.growth * to_rim)
        body, length = body[to_rim > 0.75 * grading.rim], length[to_rim > 0.75 * grading.rim]
    parts.append(_on_surface(body[scatter(body, _RADIUS * length, taken=rim, generator=generator)]))
    rigid = [surface_points(surface, _SPACING) for surface in surfaces.rigid]
    for k, points in enumerate(rigid):
        others = np.concatenate([body, *(other for j, other in enumerate(rigid) if j != k)])
        clearance, _ = cKDTree(others).query(points)
        length = np.minimum(grading.rigid, grading.near * clearance)
        parts.append(_on_surface(points[scatter(points, _RADIUS * length, generator=generator)]))
    return np.concatenate(parts)


def scatter(
    points: FloatArray, distance: FloatArray, *, generator: np.random.Generator, taken: FloatArray | None = None,
) -> BoolArray:
    """Which of `points` [mm] (n, 3) to keep so that none has another within its own `distance` [mm] (n,).

    Points are tried in random order and kept where those before them leave room (dart throwing); `taken` (q, 3) stand
    already. Every point that is not kept has a kept one within its distance.
    """
    standing = np.zeros((0, 3)) if taken is None else taken
    everything = np.concatenate([standing, points])
    radius = np.concatenate([np.zeros(len(standing)), distance])
    order = np.concatenate([np.arange(len(standing)), len(standing) + generator.permutation(len(points))])
    side = float(np.median(distance))
    cell = np.floor((everything - everything.min(axis=0)) / side).astype(np.int64)
    return _throw(everything, radius, order, cell, cell.max(axis=0) + 1, side)[len(standing):]


@numba.njit(cache=True)
def _throw(
    points: FloatArray, radius: FloatArray, order: IntArray, cell: IntArray, size: IntArray, side: float,
) -> BoolArray:  # pragma: no cover - compiled
    head = np.full(size[0] * size[1] * size[2], -1)
    following = np.full(len(points), -1)
    kept = np.zeros(len(points), dtype=np.bool_)
    for i in order:
        reach = int(np.ceil(radius[i] / side))
        free = True
        for a in range(max(cell[i, 0] - reach, 0), min(cell[i, 0] + reach + 1, size[0])):
            for b in range(max(cell[i, 1] - reach, 0), min(cell[i, 1] + reach + 1, size[1])):
                for c in range(max(cell[i, 2] - reach, 0), min(cell[i, 2] + reach + 1, size[2])):
                    j = head[(a * size[1] + b) * size[2] + c]
                    while j >= 0 and free:
                        x, y, z = points[j] - points[i]
                        free = x * x + y * y + z * z >= radius[i] * radius[i]
                        j = following[j]
        if free:
            kept[i] = True
            key = (cell[i, 0] * size[1] + cell[i, 1]) * size[2] + cell[i, 2]
            following[i] = head[key]
            head[key] = i
    return kept


def _on_surface(points: FloatArray) -> FloatArray:
    return np.column_stack([points, np.zeros(len(points)), np.full(len(points), 2.0)])
