"""Surfaces from a label map: smoothing, gaps, marching cubes, flat caps."""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage, sparse

from mixpinn.base.arrays import AnyArray, BoolArray, FloatArray, IntArray
from mixpinn.base.errors import InputError
from mixpinn.base.sensible import not_negative, require_settings
from mixpinn.mesh.surfaces.surface import DomainSurfaces, Surface
from mixpinn.records.label_map import LabelMap

_MINOR_PIECE = 0.05
"""Pieces of a structure below this fraction of its largest piece are left out."""
_TOO_THIN = 0.5
"""A structure that keeps less than this fraction of its volume is too thin for smoothing and gaps."""
_SMALLEST_BLUR = 0.6
"""Least standard deviation of the smoothing [voxels]: thick slices would leave terraces."""


@dataclass(frozen=True)
class SurfaceConfig:
    """How surfaces are made from labels.

    Attributes:
        body_smoothing: standard deviation of the Gaussian over the body's mask [mm].
        rigid_smoothing: the same over the signed distance of a rigid part [mm].
        gap: smallest distance between two rigid parts, and between a rigid part and the skin [mm]: what a mesher
            needs to lay tissue between them.
    """

    body_smoothing: float = 1.0
    rigid_smoothing: float = 0.8
    gap: float = 3.5

    def __post_init__(self) -> None:
        require_settings(self, "surface", not_negative(self, "body_smoothing", "rigid_smoothing", "gap"))


def signed_distance(mask: BoolArray, spacing: FloatArray) -> FloatArray:
    """Signed distance of each voxel centre from the boundary of `mask` [mm]: negative inside.

    The Euclidean transform measures from centre to centre; the boundary runs half a voxel before that.
    """
    half = 0.5 * float(np.min(spacing))
    outside = ndimage.distance_transform_edt(~mask, sampling=spacing)
    inside = ndimage.distance_transform_edt(mask, sampling=spacing)
    distance: FloatArray = np.where(mask, half - inside, outside - half)
    return distance


def extract_surfaces(label_map: LabelMap, config: SurfaceConfig | None = None) -> DomainSurfaces:
    """Surfaces of the body and of each rigid part, by marching cubes on smoothed masks.

    The body is everything that carries a label, its holes filled, closed by flat caps where the image ends. Small
    islands are left out. Rigid parts keep the gap of the configuration: with signed distances s (negative inside)
    part A becomes {max(s_A, (s_A − s_B + gap) / 2, s_body + gap) < 0}. Since s_A − s_B changes by at most twice the
    distance walked, points of the new A and the new B lie at least `gap` apart. Where the label map names targets,
    other parts that are too thin for that are left out: soft tissue.

    Raises:
        InputError: a structure is absent, or, where it may not be left out, too thin to survive smoothing and gaps.
    """
    config = config or SurfaceConfig()
    spacing = np.linalg.norm(label_map.affine[:3, :3], axis=0)
    body = _main_pieces(label_map.labels > 0, label_map.soft_names[0])
    # Edge values are repeated while smoothing and caps are laid on afterwards, so that they stay flat and sharp.
    level = 0.5 - ndimage.gaussian_filter(
        body.astype(np.float32), _blur(config.body_smoothing, spacing), mode="nearest", truncate=3.0,
    )
    surface = _without_bubbles(_contour(_capped(level), -np.ones(3), label_map, label_map.soft_names[0]))
    _refuse_thin(surface, body, label_map, config)
    return DomainSurfaces(surface, _rigid_surfaces(label_map, body, spacing, config))


def label_surface(label_map: LabelMap, mask: AnyArray, name: str) -> Surface:
    """The surface of `mask` as it is in the label map: marching cubes without smoothing, all pieces kept."""
    where = np.argwhere(mask)
    if not len(where):
        raise InputError(
            name, expected="at least one voxel in the label map", got="none", fix="segment it again or leave it out",
        )
    low = where.min(axis=0)
    box = tuple(slice(a, b + 1) for a, b in zip(low, where.max(axis=0), strict=True))
    return _contour(np.pad(0.5 - mask[box].astype(np.float32), 1, constant_values=0.5), low - 1.0, label_map, name)


def _rigid_surfaces(
    label_map: LabelMap, body: BoolArray, spacing: FloatArray, config: SurfaceConfig,
) -> tuple[Surface, ...]:
    first = len(label_map.soft_names) + 1
    where = np.argwhere(label_map.labels >= first)
    if not label_map.rigid_names or not len(where):
        return ()
    margin = np.ceil((4.0 * config.rigid_smoothing + config.gap) / spacing).astype(int) + 2
    low = np.maximum(where.min(axis=0) - margin, 0)
    high = np.minimum(where.max(axis=0) + margin + 1, body.shape)
    box = tuple(slice(a, b) for a, b in zip(low, high, strict=True))
    ends = [(int(a == 0), int(b == n)) for a, b, n in zip(low, high, body.shape, strict=True)]
    inner = tuple(slice(a, -b or None) for a, b in ends)
    to_skin = signed_distance(np.pad(body[box], ends), spacing)[inner]
    blur = _blur(config.rigid_smoothing, spacing)
    masks = [_main_pieces(label_map.labels[box] == first + k, name) for k, name in enumerate(label_map.rigid_names)]
    distances = [
        ndimage.gaussian_filter(signed_distance(mask, spacing), blur, mode="nearest").astype(np.float32)
        for mask in masks
    ]
    spared = set(label_map.rigid_names) - set(label_map.target_names) if label_map.target_names else set()
    surfaces: list[Surface] = []
    for k, name in enumerate(label_map.rigid_names):
        level = np.maximum(distances[k], to_skin + config.gap)
        for other, distance in enumerate(distances):
            if other != k:
                level = np.maximum(level, (distances[k] - distance + config.gap) / 2.0)
        level = np.pad(level, 1, constant_values=float(spacing.max()))
        surface = _without_bubbles(_contour(level, low - 1.0, label_map, name))
        if name in spared and _kept(surface, masks[k], label_map) < _TOO_THIN:
            continue
        _refuse_thin(surface, masks[k], label_map, config)
        surfaces.append(surface)
    return tuple(surfaces)


def _blur(smoothing: float, spacing: FloatArray) -> FloatArray:
    blur: FloatArray = np.maximum(smoothing / spacing, _SMALLEST_BLUR)
    return blur


def _capped(level: AnyArray) -> AnyArray:
    """`level` with a layer round it: |level|, which puts the surface on the outer faces of the voxels that end it."""
    capped = np.pad(level, 1, mode="edge")
    for axis in range(3):
        for end in (0, -1):
            layer = np.moveaxis(capped, axis, 0)[end]
            np.maximum(np.abs(layer), 1e-3, out=layer)
    return capped


def _main_pieces(mask: AnyArray, name: str) -> BoolArray:
    if not mask.any():
        raise InputError(
            name, expected="at least one voxel in the label map", got="none", fix="segment it again or leave it out",
        )
    filled = ndimage.binary_fill_holes(mask)
    pieces, n_pieces = ndimage.label(filled)
    if n_pieces == 1:
        return np.asarray(filled, dtype=bool)
    sizes = np.bincount(pieces.ravel())
    sizes[0] = 0
    kept: BoolArray = (sizes >= _MINOR_PIECE * sizes.max())[pieces]
    return kept


def _contour(level: AnyArray, start: FloatArray, label_map: LabelMap, name: str) -> Surface:
    """Surface level = 0, outward normals towards positive values; `start` is the voxel index of level[0, 0, 0]."""
    if not (level.min() < 0.0 < level.max()):
        return Surface(name, np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64))
    from skimage.measure import marching_cubes

    points, triangles, _, _ = marching_cubes(level, 0.0)
    points = (points.astype(np.float64) + start) @ label_map.affine[:3, :3].T + label_map.affine[:3, 3]
    surface = Surface(name, points, triangles.astype(np.int64))
    return surface if surface.volume > 0.0 else surface.reversed()


def _without_bubbles(surface: Surface) -> Surface:
    """The surface without small closed pieces, and without inner ones, whose volume counts as negative."""
    n_points, triangles = len(surface.points), surface.triangles
    if not len(triangles):
        return surface
    ends = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]]])
    links = sparse.coo_matrix((np.ones(len(ends), dtype=np.int8), ends.T), shape=(n_points, n_points))
    n_pieces, piece = sparse.csgraph.connected_components(links, directed=False)
    a, b, c = np.moveaxis(surface.points[triangles], 1, 0)
    volumes = np.bincount(piece[triangles[:, 0]], np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0, n_pieces)
    kept = volumes >= _MINOR_PIECE * volumes.max()
    used = kept[piece]
    index: IntArray = np.cumsum(used) - 1
    return Surface(surface.name, surface.points[used], index[triangles[used[triangles[:, 0]]]])


def _kept(surface: Surface, mask: BoolArray, label_map: LabelMap) -> float:
    """Share of a structure's volume that smoothing and gaps have left."""
    return surface.volume / (float(mask.sum()) * label_map.voxel_volume) if len(surface.triangles) else 0.0


def _refuse_thin(surface: Surface, mask: BoolArray, label_map: LabelMap, config: SurfaceConfig) -> None:
    kept = _kept(surface, mask, label_map)
    if kept < _TOO_THIN:
        raise InputError(
            surface.name, expected="a structure thicker than the smoothing and the gap to its neighbours",
            got=f"one that keeps {100 * kept:.0f} % of its volume with a gap of {config.gap:g} mm",
            fix="choose a smaller size, gap or smoothing, or mend the label map",
        )
