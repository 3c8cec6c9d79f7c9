"""How faithful a mesh is to the label map it was made from."""

from dataclasses import dataclass

import numba
import numpy as np
from scipy import ndimage, spatial

from mixpinn.base.arrays import AnyArray, BoolArray, FloatArray, IntArray
from mixpinn.mesh.surfaces.extract import label_surface
from mixpinn.mesh.surfaces.surface import Surface
from mixpinn.records.label_map import LabelMap
from mixpinn.records.tissue_mesh import TissueMesh

_SAMPLES = 20_000
"""Points a surface that the Hausdorff distances are taken over."""


@dataclass(frozen=True)
class StructureFidelity:
    """One structure of the mesh against the label map.

    Attributes:
        name: of the structure.
        dice: 2 |A ∩ B| / (|A| + |B|) over the voxels of the label map.
        hausdorff: largest distance between the two surfaces, either way [mm].
        hausdorff_95: 95th percentile of these distances, the larger of the two ways [mm].
    """

    name: str
    dice: float
    hausdorff: float
    hausdorff_95: float


@dataclass(frozen=True)
class MeshFidelity:
    """Fidelity of the body (rigid parts included) and of each rigid part.

    Attributes:
        structures: the body first.
    """

    structures: tuple[StructureFidelity, ...]

    def markdown(self) -> str:
        """The figures as a table in Markdown."""
        rows = [
            f"| {s.name} | {s.dice:.4f} | {s.hausdorff_95:.2f} | {s.hausdorff:.2f} |" for s in self.structures
        ]
        head = ["| Structure | Dice | Hausdorff 95 % [mm] | Hausdorff [mm] |", "| --- | ---: | ---: | ---: |"]
        return "\n".join([*head, *rows, ""])


def mesh_fidelity(mesh: TissueMesh, label_map: LabelMap) -> MeshFidelity:
    """Compare `mesh` with `label_map`: the body is everything labelled, a rigid part is its cavity."""
    regions = voxel_parts(mesh, label_map)
    faces, owner = mesh.boundary_faces, _face_parts(mesh)
    structures = []
    for k, name in enumerate((label_map.soft_names[0], *mesh.rigid_names)):
        meshed = regions >= 0 if k == 0 else regions == k
        labelled = label_map.labels > 0 if k == 0 else label_map.mask(name)
        surface = Surface(name, mesh.points, faces[owner == k])
        structures.append(StructureFidelity(
            name, dice(meshed, labelled), *surface_distances(surface, label_surface(label_map, labelled, name)),
        ))
    return MeshFidelity(tuple(structures))


def dice(first: AnyArray, second: AnyArray) -> float:
    """Dice coefficient of two masks; 1 where both are empty."""
    total = int(first.sum()) + int(second.sum())
    return 2.0 * int((first & second).sum()) / total if total else 1.0


def surface_distances(first: Surface, second: Surface) -> tuple[float, float]:
    """Hausdorff distance and its 95 % version between two surfaces [mm], symmetric, over sampled points."""
    there = np.abs(second.distance(_samples(first)))
    back = np.abs(first.distance(_samples(second)))
    return float(max(there.max(), back.max())), float(max(np.percentile(there, 95), np.percentile(back, 95)))


def voxel_parts(mesh: TissueMesh, label_map: LabelMap) -> AnyArray:
    """What the mesh has at each voxel centre: −1 nothing, 0 soft tissue, k the cavity of rigid part k; int16.

    Voxels that the cells leave out and enclose are cavity; each goes to the part of the nearest boundary node.
    """
    inverse = np.linalg.inv(label_map.affine)
    points = mesh.points @ inverse[:3, :3].T + inverse[:3, 3]
    filled = np.zeros(label_map.labels.shape, dtype=np.bool_)
    _fill_cells(points, mesh.cells, filled)
    regions = np.where(filled, 0, -1).astype(np.int16)
    rigid = points[mesh.part > 0]
    if not len(rigid):
        return regions
    low = np.maximum(np.floor(rigid.min(axis=0)).astype(int) - 1, 0)
    high = np.minimum(np.ceil(rigid.max(axis=0)).astype(int) + 2, filled.shape)
    box = tuple(slice(a, b) for a, b in zip(low, high, strict=True))
    cavity = ndimage.binary_fill_holes(filled[box]) & ~filled[box]
    where = np.argwhere(cavity) + low
    _, nearest = spatial.cKDTree(mesh.points[mesh.part > 0]).query(
        where @ label_map.affine[:3, :3].T + label_map.affine[:3, 3],
    )
    regions[tuple(where.T)] = mesh.part[mesh.part > 0][nearest]
    return regions


@numba.njit(cache=True)
def _fill_cells(points: FloatArray, cells: IntArray, filled: BoolArray) -> None:  # pragma: no cover - compiled
    """Mark the voxel centres inside each cell; `points` in voxel indices."""
    tolerance = -1e-9
    for cell in range(len(cells)):
        a, b, c, d = points[cells[cell, 0]], points[cells[cell, 1]], points[cells[cell, 2]], points[cells[cell, 3]]
        matrix = np.empty((3, 3))
        matrix[:, 0], matrix[:, 1], matrix[:, 2] = b - a, c - a, d - a
        inverse = np.linalg.inv(matrix)
        low, high = np.empty(3, dtype=np.int64), np.empty(3, dtype=np.int64)
        for axis in range(3):
            low[axis] = max(int(np.ceil(min(a[axis], b[axis], c[axis], d[axis]))), 0)
            high[axis] = min(int(np.floor(max(a[axis], b[axis], c[axis], d[axis]))), filled.shape[axis] - 1)
        for i in range(low[0], high[0] + 1):
            for j in range(low[1], high[1] + 1):
                for k in range(low[2], high[2] + 1):
                    x, y, z = i - a[0], j - a[1], k - a[2]
                    u = inverse[0, 0] * x + inverse[0, 1] * y + inverse[0, 2] * z
                    v = inverse[1, 0] * x + inverse[1, 1] * y + inverse[1, 2] * z
                    w = inverse[2, 0] * x + inverse[2, 1] * y + inverse[2, 2] * z
                    if u >= tolerance and v >= tolerance and w >= tolerance and u + v + w <= 1.0 - tolerance:
                        filled[i, j, k] = True


def _face_parts(mesh: TissueMesh) -> AnyArray:
    """Part of each boundary face: that of most of its nodes."""
    return np.sort(mesh.part[mesh.boundary_faces], axis=1)[:, 1]


def _samples(surface: Surface) -> FloatArray:
    """About as many points of a surface as `_SAMPLES`: its vertices, and if these are few, points in its triangles."""
    corners = surface.points[surface.triangles]
    used = surface.points[np.unique(surface.triangles)]
    if len(used) >= _SAMPLES:
        return used[:: -(-len(used) // _SAMPLES)]
    steps = max(2, int(np.sqrt(2.0 * _SAMPLES / len(corners))))
    i, j = (grid.ravel() for grid in np.meshgrid(np.arange(steps + 1), np.arange(steps + 1)))
    weights = np.column_stack([i, j, steps - i - j])[i + j <= steps] / steps
    points: FloatArray = np.einsum("wi,tij->twj", weights, corners).reshape(-1, 3)
    return points
