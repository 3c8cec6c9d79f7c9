"""Closed triangle surfaces of the structures of a label map."""

from dataclasses import dataclass

import numpy as np
import pyvista as pv
from scipy import ndimage, sparse
from skimage.measure import marching_cubes

from mixpinn.base.arrays import AnyArray, BoolArray, FloatArray, IntArray
from mixpinn.base.errors import InputError
from mixpinn.records.label_map import LabelMap

_MINOR_PIECE = 0.05
"""Pieces of a structure below this fraction of its largest piece are left out."""


@dataclass(frozen=True, eq=False)
class Surface:
    """A triangle surface with outward normals.

    Attributes:
        name: of the structure it bounds.
        points: [mm], float64, shape (p, 3).
        triangles: shape (t, 3).
    """

    name: str
    points: FloatArray
    triangles: IntArray

    @property
    def volume(self) -> float:
        """Enclosed volume [mm³], by the divergence theorem: the sum of a · (b × c) / 6 over the triangles."""
        a, b, c = np.moveaxis(self.points[self.triangles], 1, 0)
        return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)

    def polydata(self) -> pv.PolyData:
        """The surface for `pyvista`."""
        return pv.PolyData.from_regular_faces(self.points, self.triangles)

    def distance(self, points: FloatArray) -> FloatArray:
        """Signed distance of `points` [mm], shape (q,): negative inside."""
        cloud = pv.PolyData(np.asarray(points, dtype=np.float64)).compute_implicit_distance(self.polydata())
        return np.asarray(cloud["implicit_distance"], dtype=np.float64)


@dataclass(frozen=True, eq=False)
class DomainSurfaces:
    """What bounds the soft tissue: the skin with the caps of the crop, and the rigid parts, which are cavities."""

    body: Surface
    rigid: tuple[Surface, ...]

    def domain(self) -> tuple[FloatArray, IntArray]:
        """Points and triangles of all surfaces together, normals pointing out of the soft tissue."""
        surfaces = (self.body, *self.rigid)
        starts = np.cumsum([0, *(len(surface.points) for surface in surfaces)])
        triangles = [
            (surface.triangles if surface is self.body else surface.triangles[:, ::-1]) + start
            for surface, start in zip(surfaces, starts[:-1], strict=True)
        ]
        return np.concatenate([surface.points for surface in surfaces]), np.concatenate(triangles)


@dataclass(frozen=True)
class SurfaceConfig:
    """How surfaces are made from labels.

    Attributes:
        body_smoothing: standard deviation of the Gaussian over the body's mask [mm].
        rigid_smoothing: the same over the mask of a rigid part [mm].
        gap: smallest distance between two rigid parts, and between a rigid part and the skin [mm]: what a mesher
            needs to lay tissue between them.
    """

    body_smoothing: float = 1.5
    rigid_smoothing: float = 1.0
    gap: float = 2.0


def make_surfaces(label_map: LabelMap, config: SurfaceConfig | None = None) -> DomainSurfaces:
    """Surfaces of the body and of each rigid part, by marching cubes on the smoothed masks.

    The body is everything that carries a label, its holes filled, closed by flat caps where the image ends. Small
    islands are left out. Rigid parts keep the gap of the configuration: with signed distances s (negative inside)
    part A becomes {max(s_A, (s_A − s_B + gap) / 2, s_body + gap) < 0}. Since s_A − s_B changes at most by twice the
    distance walked, points of the new A and B are at least `gap` apart.

    Raises:
        InputError: a structure is absent, or too thin to survive smoothing and the gap.
    """
    config = config or SurfaceConfig()
    spacing = np.linalg.norm(label_map.affine[:3, :3], axis=0)
    n_soft = len(label_map.soft_names)
    body = _largest_pieces(ndimage.binary_fill_holes(label_map.labels > 0), label_map.soft_names[0])
    # Edge values are repeated before smoothing and zeros laid around afterwards: the caps stay flat and sharp.
    body_level = np.pad(_smooth_distance(body, spacing, config.body_smoothing), 1, constant_values=_FAR)
    body_surface = _extract(body_level, -np.ones(3), label_map, label_map.soft_names[0], body)
    if not label_map.rigid_names:
        return DomainSurfaces(body_surface, ())

    where = np.argwhere(label_map.labels > n_soft)
    if not len(where):
        raise InputError(
            ", ".join(label_map.rigid_names), expected="at least one voxel each", got="none",
            fix="choose other structures",
        )
    margin = np.ceil(4.0 * config.rigid_smoothing / spacing + 3.0).astype(int)
    low = np.maximum(where.min(axis=0) - margin, 0)
    high = np.minimum(where.max(axis=0) + margin + 1, label_map.labels.shape)
    box = tuple(slice(a, b) for a, b in zip(low, high, strict=True))
    masks = [
        _largest_pieces(ndimage.binary_fill_holes(label_map.labels[box] == n_soft + 1 + k), name)
        for k, name in enumerate(label_map.rigid_names)
    ]
    distances = [signed_distance(mask, spacing) for mask in masks]
    padding = np.array([(int(a == 0), int(b == n)) for a, b, n in zip(low, high, body.shape, strict=True)])
    to_skin = signed_distance(np.pad(body, 1), spacing)[tuple(slice(a + 1, b + 1) for a, b in zip(low, high, strict=True))]
    del padding
    rigid = []
    for k, name in enumerate(label_map.rigid_names):
        level = np.maximum(_smooth_distance(masks[k], spacing, config.rigid_smoothing), to_skin + config.gap)
        for other, distance in enumerate(distances):
            if other != k:
                level = np.maximum(level, (distances[k] - distance + config.gap) / 2.0)
        rigid.append(_extract(np.pad(level, 1, constant_values=_FAR), low - 1.0, label_map, name, masks[k]))
    return DomainSurfaces(body_surface, tuple(rigid))
