"""Probe: the rigid tool's surface; ProbePath: how it moves."""

import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mixpinn.base.arrays import FloatArray, IntArray
from mixpinn.base.errors import InputError
from mixpinn.base.files import hash_arrays
from mixpinn.records.vtk_file import write_vtk


@dataclass(frozen=True, eq=False)
class Probe:
    """A rigid triangle mesh, closed or open with a rim; its tip lies at the origin and it points to −y.

    Attributes:
        points: vertices [mm], float64, shape (p, 3).
        triangles: shape (t, 3).
        name: for tables and pictures.
    """

    points: FloatArray
    triangles: IntArray
    name: str = "probe"

    def hash(self) -> str:
        """Identity of the geometry."""
        return hash_arrays(self.points, self.triangles)

    def save(self, path: Path | str) -> None:
        """Write an ``.stl``."""
        import pyvista as pv

        write_vtk(path, pv.PolyData.from_regular_faces(self.points, self.triangles))

    @staticmethod
    def load(path: Path | str) -> "Probe":
        """Read any surface that `pyvista` reads (.stl, .ply, .vtp, .obj); duplicate vertices are merged.

        Raises:
            InputError: absent, unreadable or without triangles.
        """
        import pyvista as pv

        path = Path(path)
        if not path.is_file():
            raise InputError(str(path), expected="a probe surface (.stl)", got="no such file", fix="check the path")
        try:
            with pv.vtk_verbosity("off"), warnings.catch_warnings():
                warnings.simplefilter("ignore")
                read = pv.read(path)
            surface = read.extract_surface(algorithm="dataset_surface").triangulate().clean()
            triangles = surface.regular_faces.astype(np.int64)
        except Exception as error:
            raise InputError(
                str(path), expected="a readable triangle surface", got=str(error), fix="export it as STL",
            ) from error
        points = np.asarray(surface.points, dtype=np.float64)
        if not len(triangles) or not np.isfinite(points).all():
            raise InputError(
                str(path), expected="a triangle surface with finite vertices",
                got=f"{len(triangles)} readable triangles", fix="export the probe again as STL",
            )
        return Probe(points, triangles, path.stem)


@dataclass(frozen=True, eq=False)
class ProbePath:
    """Poses of the probe, step by step: vertex p lies at rotations[s] @ p + translations[s].

    Attributes:
        translations: tip position [mm], shape (s, 3).
        rotations: rotation matrices, shape (s, 3, 3).
        depths: indentation depth of each step [mm], shape (s,); steps with depth < 1 are approach.
    """

    translations: FloatArray
    rotations: FloatArray
    depths: FloatArray

    def __len__(self) -> int:
        return len(self.translations)
