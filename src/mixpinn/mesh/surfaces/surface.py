"""Closed triangle surfaces: of one structure, and of all that bound the soft tissue."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mixpinn.base.arrays import FloatArray, IntArray
from mixpinn.base.files import hash_arrays
from mixpinn.records.surface_file import read_surface

if TYPE_CHECKING:
    import pyvista as pv


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

    def polydata(self) -> "pv.PolyData":
        """The surface for `pyvista`."""
        import pyvista as pv

        return pv.PolyData.from_regular_faces(self.points, self.triangles)

    def distance(self, points: FloatArray) -> FloatArray:
        """Signed distance of `points` [mm], shape (q,): negative inside."""
        import pyvista as pv

        cloud = pv.PolyData(np.asarray(points, dtype=np.float64)).compute_implicit_distance(self.polydata())
        return np.asarray(cloud["implicit_distance"], dtype=np.float64)

    def reversed(self) -> "Surface":
        """The same surface with its normals turned round."""
        return Surface(self.name, self.points, self.triangles[:, ::-1])

    @staticmethod
    def load(path: Path | str, *, name: str | None = None) -> "Surface":
        """Read any surface that `pyvista` reads (.stl, .ply, .vtp, .obj); duplicate vertices are merged.

        Whether it is closed and free of self-intersections is checked by `mixpinn.mesh.surfaces.check_surface`.

        Raises:
            InputError: absent, unreadable or without triangles.
        """
        path = Path(path)
        points, triangles = read_surface(
            path, expected="a closed triangle surface (.stl)", fix="check the path or export the surface again",
        )
        return Surface(name or path.stem, points, triangles)


@dataclass(frozen=True, eq=False)
class DomainSurfaces:
    """What bounds the soft tissue: the skin with the caps of the crop, and the rigid parts, which are cavities.

    Attributes:
        body: the outer surface.
        rigid: surfaces of the rigid parts 1 … K, disjoint and inside the body.
    """

    body: Surface
    rigid: tuple[Surface, ...]

    @property
    def rigid_names(self) -> tuple[str, ...]:
        """Names of the rigid parts 1 … K."""
        return tuple(surface.name for surface in self.rigid)

    def domain(self) -> tuple[FloatArray, IntArray]:
        """Points [mm] (p, 3) and triangles (t, 3) of all surfaces, normals pointing out of the soft tissue."""
        surfaces = (self.body, *(surface.reversed() for surface in self.rigid))
        starts = np.cumsum([0, *(len(surface.points) for surface in surfaces)])
        triangles = [surface.triangles + start for surface, start in zip(surfaces, starts[:-1], strict=True)]
        return np.concatenate([surface.points for surface in surfaces]), np.concatenate(triangles)

    def hash(self) -> str:
        """Identity of the geometry."""
        return hash_arrays(*self.domain())
