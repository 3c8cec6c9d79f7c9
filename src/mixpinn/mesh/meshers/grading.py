"""How long edges are, and where: fine under the probe and round rigid parts, coarse elsewhere."""

from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.spatial import cKDTree

from mixpinn.base.arrays import BoolArray, FloatArray
from mixpinn.base.errors import InputError
from mixpinn.base.sensible import positive, require_settings
from mixpinn.mesh.cells.label import FixedRegion
from mixpinn.mesh.surfaces.surface import DomainSurfaces, Surface

_COLUMN = 5.0
"""Width of the columns along y in which the hindmost skin is looked for [mm]."""
_CANDIDATE_SPACING = 2.0
"""About the distance between the points that stand for a surface [mm]."""


@dataclass(frozen=True)
class Grading:
    """Edge lengths of a graded mesh [mm] and how they grow between the places that they are given for.

    The length at a point is the smallest of `elsewhere`, `probed` + `growth` · (distance to the probed skin), `rigid` +
    `growth` · (distance to the rigid parts), and `fixed` + `growth` · (distance to the border of the region in which
    the skin is fixed), where stresses are singular as at a probe's rim. The probed skin is what a probe that comes
    along −y meets over the rigid parts and up to `reach` beside them.

    Attributes:
        probed: on the probed skin [mm].
        rigid: on the surfaces of rigid parts [mm].
        rim: along the rims of the crop's caps [mm].
        fixed: along the border of the region in which the skin is fixed [mm].
        elsewhere: on the other skin and the caps, and the largest inside [mm].
        growth: increase of the length with the distance, mm per mm.
        reach: how far the probed skin extends beyond the rigid parts in x and z: half a probe's width [mm].
        near: where two surfaces run close to each other, the length on a rigid part is at most this many times their
            distance, so that the facets of the one stay clear of the other.
        distance: largest distance of a facet's centre from the surface [mm].
        angle: smallest angle of a facet [degree].
    """

    probed: float = 8.0
    rigid: float = 6.0
    rim: float = 14.0
    fixed: float = 24.0
    elsewhere: float = 24.0
    growth: float = 0.35
    reach: float = 30.0
    near: float = 0.8
    distance: float = 1.25
    angle: float = 30.0

    def __post_init__(self) -> None:
        require_settings(self, "grading", positive(self, *(item.name for item in fields(self))))

    def scaled(self, size: float) -> "Grading":
        """The edge lengths and the facets' distance multiplied by `size`; above 1 coarser, below 1 finer.

        Raises:
            InputError: `size` is not positive.
        """
        if not size > 0.0:
            raise InputError("size", expected="a positive factor", got=f"{size:g}", fix="1 is the default, 2 coarser")
        lengths = ("probed", "rigid", "rim", "fixed", "elsewhere", "distance")
        return replace(self, **{name: size * getattr(self, name) for name in lengths})


class SizingField:
    """The edge length of a `Grading` at any point, for given surfaces."""

    def __init__(self, surfaces: DomainSurfaces, grading: Grading) -> None:
        self.grading = grading
        body = surface_points(surfaces.body, _CANDIDATE_SPACING)
        rigid = [surface_points(surface, _CANDIDATE_SPACING) for surface in surfaces.rigid]
        over = np.concatenate(rigid) if rigid else body
        self._probed = cKDTree(body[probed_skin(body, over, reach=grading.reach)])
        self._rigid = cKDTree(over) if rigid else None
        border = FixedRegion.of(surfaces.body.points).border(body, within=_CANDIDATE_SPACING)
        self._fixed = cKDTree(body[border]) if border.any() else None

    def __call__(self, points: FloatArray) -> FloatArray:
        """Edge length at `points` [mm] (q, 3); shape (q,)."""
        grading = self.grading
        length = np.minimum(grading.elsewhere, grading.probed + grading.growth * self._probed.query(points)[0])
        if self._rigid is not None:
            length = np.minimum(length, grading.rigid + grading.growth * self._rigid.query(points)[0])
        if self._fixed is not None:
            length = np.minimum(length, grading.fixed + grading.growth * self._fixed.query(points)[0])
        return np.asarray(length, dtype=np.float64)


def probed_skin(body: FloatArray, over: FloatArray, *, reach: float) -> BoolArray:
    """Which points of the body's surface [mm] (p, 3) a probe meets that comes along −y over the points `over`.

    These lie within the extent of `over` in x and z, widened by `reach` [mm], and are the hindmost of their column.
    """
    low, high = over.min(axis=0) - reach, over.max(axis=0) + reach
    inside = (body[:, [0, 2]] > low[[0, 2]]).all(axis=1) & (body[:, [0, 2]] < high[[0, 2]]).all(axis=1)
    column = np.floor((body[:, [0, 2]] - body[:, [0, 2]].min(axis=0)) / _COLUMN).astype(np.int64)
    key = column[:, 0] * (column[:, 1].max() + 1) + column[:, 1]
    hindmost = np.full(key.max() + 1, -np.inf)
    np.maximum.at(hindmost, key, body[:, 1])
    met: BoolArray = inside & (body[:, 1] > hindmost[key] - _COLUMN)
    return met


def surface_points(surface: Surface, spacing: float) -> FloatArray:
    """Points on `surface` about `spacing` [mm] apart, shape (q, 3): its vertices thinned, large triangles divided."""
    corners = surface.points[surface.triangles]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    steps = np.ceil(longest / (2.0 * spacing)).astype(np.int64)
    points = [surface.points]
    for n in np.unique(steps[steps > 1]):
        i, j = (grid.ravel() for grid in np.meshgrid(np.arange(2 * n + 1), np.arange(2 * n + 1)))
        weights = np.column_stack([i, j, 2 * n - i - j])[i + j <= 2 * n] / (2.0 * n)
        points.append(np.einsum("wi,tij->twj", weights, corners[steps == n]).reshape(-1, 3))
    everything = np.concatenate(points)
    cell = np.floor((everything - everything.min(axis=0)) / spacing).astype(np.int64)
    size = cell.max(axis=0) + 1
    _, first = np.unique((cell[:, 0] * size[1] + cell[:, 1]) * size[2] + cell[:, 2], return_index=True)
    return np.asarray(everything[np.sort(first)], dtype=np.float64)
