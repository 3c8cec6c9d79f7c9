"""What is what in a mesh: the part of each node, the tissue of each cell, the fixed nodes, cells between parts."""

from dataclasses import dataclass, replace

import numpy as np

from mixpinn.base.arrays import AnyArray, BoolArray, FloatArray, Int32Array
from mixpinn.base.errors import InputError
from mixpinn.mesh.cells.tissues import cell_tissues
from mixpinn.mesh.surfaces.surface import DomainSurfaces
from mixpinn.records.label_map import LabelMap
from mixpinn.records.tetrahedra import TETRA_FACES
from mixpinn.records.tissue_mesh import TissueMesh

FIXED_DEPTH = 30.0
"""Skin nodes within this distance of the most anterior point are fixed [mm]."""
CAP_MARGIN = 1.0
"""Nodes closer than this to a cap of the crop are not fixed [mm]."""


def label_mesh(
    points: FloatArray, cells: Int32Array, surfaces: DomainSurfaces, *, label_map: LabelMap | None = None,
) -> TissueMesh:
    """Name the parts of a mesh: every node belongs to exactly one part, every cell to one soft tissue.

    A node on the mesh's boundary belongs to the structure whose surface is nearest: the skin, which is soft, or a
    rigid part. Inner nodes are soft. A cell belongs to the soft tissue, or the mixture of two, that `label_map` has in
    it (`mixpinn.mesh.cells.tissues`). Fixed are the nodes in the region that the body's surface defines, whatever the
    mesh, and those of rigid parts that the crop has cut.

    Args:
        points: [mm], shape (n, 3).
        cells: positively oriented, shape (m, 4).
        surfaces: what the mesh was made from.
        label_map: for the tissues and the scanner frame; without it there is one tissue.

    Raises:
        InputError: a rigid part has no node, because the mesh is too coarse for it.
    """
    part = nearest_part(points, cells, surfaces)
    absent = [name for k, name in enumerate(surfaces.rigid_names, start=1) if not (part == k).any()]
    if absent:
        raise InputError(
            ", ".join(absent), expected="a structure large enough for the mesh size", got="one without a mesh node",
            fix="choose a smaller size",
        )
    mesh = TissueMesh(
        points, cells, part, np.zeros(len(points), dtype=bool), surfaces.rigid_names,
        np.zeros(len(cells), dtype=np.int16),
    )
    if label_map is not None:
        tissue, names = cell_tissues(points[cells], label_map)
        mesh = replace(
            mesh, tissue=tissue, tissue_names=names,
            world_to_scanner=label_map.world_to_scanner, doubts=label_map.doubts, targets=_targets(label_map),
        )
    held = [] if label_map is None else [
        k for k, name in enumerate(surfaces.rigid_names, start=1) if name in label_map.cut_names
    ]
    fixed = fixed_nodes(mesh, region=FixedRegion.of(surfaces.body.points)) | np.isin(part, held)
    return replace(mesh, fixed=fixed)


def _targets(label_map: LabelMap) -> tuple[str, ...]:
    """The targets where they are not all rigid parts."""
    every = set(label_map.target_names) == set(label_map.rigid_names)
    return () if every else label_map.target_names


def nearest_part(points: FloatArray, cells: AnyArray, surfaces: DomainSurfaces) -> AnyArray:
    """Part of each node, int16, shape (n,): for boundary nodes the nearest surface's, 0 for all others."""
    faces = np.asarray(cells)[:, TETRA_FACES].reshape(-1, 3)
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    boundary = np.unique(faces[first[count == 1]])
    nearest = np.abs(surfaces.body.distance(points[boundary]))
    part = np.zeros(len(points), dtype=np.int16)
    for k, surface in enumerate(surfaces.rigid, start=1):
        distance = np.abs(surface.distance(points[boundary]))
        part[boundary[distance < nearest]] = k
        nearest = np.minimum(nearest, distance)
    return part


@dataclass(frozen=True)
class FixedRegion:
    """Where the protocol holds the skin, in mm of the world frame: a property of the geometry, not of a mesh.

    Attributes:
        behind: the region ends at this y; smaller y is anterior [mm].
        low, high: and lies between these z [mm].
    """

    behind: float
    low: float
    high: float

    @staticmethod
    def of(points: FloatArray) -> "FixedRegion":
        """Less than 30 mm behind the most anterior of `points` [mm] (p, 3), more than 1 mm from the caps.

        The points are those of the body's surface; smallest and largest z are the two caps of the crop.
        """
        y, z = points[:, 1], points[:, 2]
        return FixedRegion(float(y.min()) + FIXED_DEPTH, float(z.min()) + CAP_MARGIN, float(z.max()) - CAP_MARGIN)

    def holds(self, points: FloatArray) -> BoolArray:
        """Which of `points` [mm] (p, 3), of the body's surface, lie in the region."""
        y, z = points[:, 1], points[:, 2]
        inside: BoolArray = (y < self.behind) & (z > self.low) & (z < self.high)
        return inside

    def border(self, points: FloatArray, *, within: float) -> BoolArray:
        """Which of `points` [mm] (p, 3), of the body's surface, lie `within` so many mm of the region's border."""
        y, z = points[:, 1], points[:, 2]
        wider = (y < self.behind + within) & (z > self.low - within) & (z < self.high + within)
        inner = (y < self.behind - within) & (z > self.low + within) & (z < self.high - within)
        return wider & ~inner


def fixed_nodes(mesh: TissueMesh, *, region: FixedRegion | None = None) -> BoolArray:
    """Nodes that the protocol holds in place: the soft skin nodes within `region`; shape (n,).

    Without `region` it is taken from the mesh's own nodes, for meshes that come without their surfaces.
    """
    region = region or FixedRegion.of(mesh.points)
    skin = np.zeros(mesh.n_points, dtype=bool)
    skin[mesh.skin_faces] = True
    held: BoolArray = skin & (mesh.part == 0) & region.holds(mesh.points)
    return held


@dataclass(frozen=True)
class PartContacts:
    """Where rigid parts meet in the mesh.

    Attributes:
        spanning_cells: cells with nodes of two or more rigid parts: tissue one cell thick between neighbours.
        rigid_cells: cells whose nodes all belong to one rigid part: tissue in its hollows, which moves with it.
        bridging_faces: boundary faces with nodes of two different parts, where two cavities have run together.
    """

    spanning_cells: int
    rigid_cells: int
    bridging_faces: int


def part_contacts(mesh: TissueMesh) -> PartContacts:
    """Count cells and boundary faces that touch more than one rigid part, and cells that lie in one entirely."""
    of_cell, of_face = mesh.part[mesh.cells], mesh.part[mesh.boundary_faces]
    highest = of_cell.max(axis=1)
    lowest_rigid = np.where(of_cell > 0, of_cell, highest[:, None]).min(axis=1)
    same = (of_cell == of_cell[:, :1]).all(axis=1)
    return PartContacts(
        int((lowest_rigid != highest).sum()), int((same & (highest > 0)).sum()),
        int((of_face != of_face[:, :1]).any(axis=1).sum()),
    )
