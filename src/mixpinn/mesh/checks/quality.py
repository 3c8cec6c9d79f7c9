"""How well shaped the cells are."""

from dataclasses import dataclass

import numpy as np

from mixpinn.base.arrays import AnyArray, FloatArray
from mixpinn.mesh.cells.label import part_contacts
from mixpinn.records.tetrahedra import TETRA_FACES, signed_volumes
from mixpinn.records.tissue_mesh import TissueMesh
from mixpinn.records.triangle_edges import edge_uses

_SLIVER = 5.0
"""A cell with a dihedral angle below this is counted as a sliver [degree]."""


@dataclass(frozen=True)
class MeshQuality:
    """Shape and size of a mesh's cells.

    Attributes:
        n_points: number of nodes.
        n_cells: number of cells.
        min_dihedral: smallest dihedral angle [degree].
        max_dihedral: largest dihedral angle [degree].
        low_dihedral: 1st percentile of the cells' smallest dihedral angles [degree].
        slivers: cells with a dihedral angle below 5 degrees.
        min_radius_ratio: smallest radius ratio 3 r / R; 1 for the regular tetrahedron, 0 for a flat one.
        median_radius_ratio: its median.
        min_volume: [mm³].
        median_volume: [mm³].
        inverted: cells without positive volume.
        spanning_cells: cells with nodes of two or more rigid parts.
        rigid_cells: cells with all nodes on one rigid part.
        bridging_faces: boundary faces with nodes of two different parts.
        branching_edges: edges of the boundary with more than two boundary faces.
    """

    n_points: int
    n_cells: int
    min_dihedral: float
    max_dihedral: float
    low_dihedral: float
    slivers: int
    min_radius_ratio: float
    median_radius_ratio: float
    min_volume: float
    median_volume: float
    inverted: int
    spanning_cells: int
    rigid_cells: int
    bridging_faces: int
    branching_edges: int


def dihedral_angles(points: FloatArray, cells: AnyArray) -> FloatArray:
    """The six dihedral angles of each cell [degree], shape (m, 6): π minus the angle between two outward normals."""
    corners = points[cells][:, TETRA_FACES]
    normals = np.cross(corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), np.finfo(float).tiny)
    first, second = np.triu_indices(4, 1)
    cosine = -np.einsum("mij,mij->mi", normals[:, first], normals[:, second])
    angles: FloatArray = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
    return angles


def radius_ratios(points: FloatArray, cells: AnyArray) -> FloatArray:
    """Radius ratio 3 r / R of each cell, shape (m,), with the radii of the inscribed and circumscribed spheres.

    r = 3 V / A with A the surface area, and R = |a² (b × c) + b² (c × a) + c² (a × b)| / (12 V) for the edges
    a, b, c from one corner.
    """
    corners = points[cells]
    faces = corners[:, TETRA_FACES]
    area = 0.5 * np.linalg.norm(
        np.cross(faces[:, :, 1] - faces[:, :, 0], faces[:, :, 2] - faces[:, :, 0]), axis=-1,
    ).sum(axis=1)
    volume = np.abs(signed_volumes(points, cells))
    a, b, c = (corners[:, i] - corners[:, 0] for i in (1, 2, 3))
    squares = [(edge**2).sum(axis=1, keepdims=True) for edge in (a, b, c)]
    bent = squares[0] * np.cross(b, c) + squares[1] * np.cross(c, a) + squares[2] * np.cross(a, b)
    tiny = np.finfo(float).tiny
    ratios: FloatArray = 108.0 * volume**2 / np.maximum(area * np.linalg.norm(bent, axis=1), tiny)
    return ratios


def mesh_quality(mesh: TissueMesh) -> MeshQuality:
    """Measure `mesh`."""
    angles, ratios = dihedral_angles(mesh.points, mesh.cells), radius_ratios(mesh.points, mesh.cells)
    volumes, contacts = mesh.cell_volumes, part_contacts(mesh)
    _, count, _ = edge_uses(mesh.boundary_faces)
    smallest = angles.min(axis=1)
    return MeshQuality(
        n_points=mesh.n_points, n_cells=len(mesh.cells), min_dihedral=float(smallest.min()),
        max_dihedral=float(angles.max()), low_dihedral=float(np.percentile(smallest, 1.0)),
        slivers=int((smallest < _SLIVER).sum()), min_radius_ratio=float(ratios.min()),
        median_radius_ratio=float(np.median(ratios)), min_volume=float(volumes.min()),
        median_volume=float(np.median(volumes)), inverted=int((volumes <= 0.0).sum()),
        spanning_cells=contacts.spanning_cells, rigid_cells=contacts.rigid_cells,
        bridging_faces=contacts.bridging_faces, branching_edges=int((count > 2).sum()),
    )
