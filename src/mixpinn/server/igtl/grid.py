"""The displacement on a regular grid along R, A and S: what IMAGE takes."""

from collections.abc import Mapping

import numpy as np

from mixpinn.base.arrays import AnyArray, FloatArray, IntArray
from mixpinn.base.errors import InputError
from mixpinn.records import TissueMesh
from mixpinn.records.answer import Motion
from mixpinn.server.igtl.image import ImageBody
from mixpinn.server.igtl.ras import RasFrame
from mixpinn.serving.motions import motion_matrices

_MOST_VOXELS = 2_000_000


class DisplacementGrid:
    """Where the voxels of a grid lie in the body, found once.

    Soft tissue takes the linear interpolation in its cell, a voxel inside a rigid part the part's own motion, one
    outside of the body none.

    Attributes:
        matrix: voxel index to RAS [mm], shape (4, 4).
        shape: numbers of voxels (nk, nj, ni).
    """

    def __init__(self, mesh: TissueMesh, frame: RasFrame, *, spacing: float) -> None:
        """Find the voxels.

        Args:
            mesh: the mesh at rest.
            frame: whose axes the grid follows.
            spacing: of the voxels [mm].

        Raises:
            InputError: a spacing that is not positive, or one that makes more than two million voxels.
        """
        if not spacing > 0.0:
            raise InputError("grid", expected="a spacing above 0 mm", got=f"{spacing:g}", fix="for example 10")
        ras = frame.points(mesh.points)
        low, high = ras.min(axis=0), ras.max(axis=0)
        counts = np.ceil((high - low) / spacing).astype(int) + 1
        if np.prod(counts.astype(np.float64)) > _MOST_VOXELS:
            raise InputError(
                "grid", expected=f"at most {_MOST_VOXELS} voxels", got=f"{' × '.join(map(str, counts))}",
                fix="give a larger spacing",
            )
        self.shape = (int(counts[2]), int(counts[1]), int(counts[0]))
        self.matrix = np.diag([spacing, spacing, spacing, 1.0])
        self.matrix[:3, 3] = 0.5 * (low + high) - 0.5 * spacing * (counts - 1)
        k, j, i = np.meshgrid(*map(np.arange, self.shape), indexing="ij")
        places = np.stack([i, j, k], axis=-1).reshape(-1, 3) * spacing + self.matrix[:3, 3]
        back = np.linalg.inv(frame.from_world)
        self._frame, self._world = frame, places @ back[:3, :3].T + back[:3, 3]
        self._soft, self._corners, self._weights = _in_cells(mesh, self._world)
        self._rigid = _in_parts(mesh, self._world, np.isin(np.arange(len(places)), self._soft, invert=True))
        self._mesh = mesh

    def image(self, displacement: AnyArray, motions: Mapping[str, Motion]) -> ImageBody:
        """The displacement in RAS [mm] at every voxel, 32-bit, three components.

        Args:
            displacement: of all vertices or nodes of the mesh [mm], shape (n, 3).
            motions: of the rigid parts, by name; those that are not named stay.
        """
        field = np.zeros((len(self._world), 3))
        field[self._soft] = np.einsum("vw,vwd->vd", self._weights, np.asarray(displacement)[self._corners])
        for name, matrix in zip(self._mesh.rigid_names, motion_matrices(self._mesh, motions), strict=True):
            inside = self._rigid[name]
            field[inside] = self._world[inside] @ matrix[:3, :3].T + matrix[:3, 3] - self._world[inside]
        return ImageBody(self._frame.vectors(field).astype(np.float32).reshape(*self.shape, 3), self.matrix)


def _in_cells(mesh: TissueMesh, places: FloatArray) -> tuple[IntArray, IntArray, FloatArray]:
    """Of the places in a cell their index, its vertices (v, 4) and the barycentric weights of these (v, 4)."""
    found = np.asarray(mesh.with_order(1).grid().find_containing_cell(places), dtype=np.int64)
    soft = np.flatnonzero(found >= 0)
    corners = mesh.cells[found[soft]].astype(np.int64)
    at = mesh.points[corners]
    edges = (at[:, 1:] - at[:, :1]).transpose(0, 2, 1)
    others = np.linalg.solve(edges, (places[soft] - at[:, 0])[..., None])[..., 0]
    weights = np.concatenate([1.0 - others.sum(axis=1, keepdims=True), others], axis=1)
    return soft, corners, weights


def _in_parts(mesh: TissueMesh, places: FloatArray, free: AnyArray) -> dict[str, IntArray]:
    """The free places inside each rigid part's cavity."""
    import pyvista as pv
    from vtkmodules.vtkFiltersModeling import vtkSelectEnclosedPoints

    faces, inside = mesh.boundary_faces, {}
    for k, name in enumerate(mesh.rigid_names, start=1):
        wall = faces[(mesh.part[faces] == k).all(axis=1)]
        corners = mesh.points[np.unique(wall)] if len(wall) else mesh.points[mesh.part_nodes(k)]
        low, high = corners.min(axis=0), corners.max(axis=0)
        near = np.flatnonzero(free & ((places >= low) & (places <= high)).all(axis=1))
        if len(near) and len(wall):
            chosen = vtkSelectEnclosedPoints()
            chosen.Initialize(pv.PolyData.from_regular_faces(mesh.points, wall).clean())
            near = near[[bool(chosen.IsInsideSurface(*places[index])) for index in near]]
        inside[name] = near
    return inside
