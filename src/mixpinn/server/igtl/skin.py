"""The skin as it is sent: the mesh's own triangles, or fewer of them between some of the same nodes."""

import numpy as np

from mixpinn.base.arrays import AnyArray, FloatArray, IntArray
from mixpinn.base.errors import InputError
from mixpinn.records import TissueMesh
from mixpinn.server.igtl.polydata import polygon_bytes, surface_content
from mixpinn.server.igtl.ras import RasFrame

_FEWEST = 100


class SkinSurface:
    """The skin of a mesh, ready to be sent with any displacement.

    Attributes:
        nodes: vertices of the mesh at which it is sent, shape (p,).
        triangles: outward, as indices into `nodes`, shape (f, 3).
    """

    def __init__(self, mesh: TissueMesh, frame: RasFrame, *, most_points: int | None = None) -> None:
        """Choose the nodes.

        Args:
            mesh: the mesh at rest.
            frame: in which it is sent.
            most_points: keep about this many; None keeps all.

        Raises:
            InputError: fewer than 100 points.
        """
        if most_points is not None and most_points < _FEWEST:
            raise InputError(
                "skin points", expected=f"{_FEWEST} or more", got=str(most_points), fix="give a larger number",
            )
        self.nodes, corners = np.unique(mesh.skin_faces, return_inverse=True)
        self.triangles: IntArray = corners.reshape(-1, 3)
        if most_points is not None and most_points < len(self.nodes):
            self._thin(mesh.points, most_points)
        self._frame, self._rest = frame, mesh.points[self.nodes]
        self._polygons = polygon_bytes(self.triangles)

    def content(self, displacement: AnyArray) -> bytes:
        """POLYDATA of the skin in RAS, with the length of the displacement [mm] at its points.

        Args:
            displacement: of all vertices or nodes of the mesh [mm], shape (n, 3).
        """
        moved: FloatArray = np.asarray(displacement, dtype=np.float64)[self.nodes]
        points = self._frame.points(self._rest + moved)
        lengths = np.linalg.norm(moved, axis=1)
        return surface_content(points, self._polygons, len(self.triangles), {"displacement_mm": lengths})

    def _thin(self, points: FloatArray, most_points: int) -> None:
        """Leave out nodes where the surface is flattest; those that stay are where they were."""
        import pyvista as pv

        surface = pv.PolyData.from_regular_faces(points[self.nodes], self.triangles)
        surface.point_data["node"] = self.nodes
        fewer = surface.decimate_pro(1.0 - most_points / len(self.nodes), preserve_topology=True)
        kept = np.asarray(fewer.point_data["node"])
        used, corners = np.unique(kept[fewer.regular_faces], return_inverse=True)
        self.nodes, self.triangles = used, corners.reshape(-1, 3)
