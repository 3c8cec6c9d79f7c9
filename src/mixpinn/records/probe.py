"""Probe: the rigid tool's surface; ProbePath: how it moves."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from mixpinn.base.arrays import FloatArray, IntArray
from mixpinn.base.errors import InputError
from mixpinn.base.files import hash_arrays
from mixpinn.records.probe_valleys import valley_warning
from mixpinn.records.surface_file import read_surface
from mixpinn.records.triangle_edges import edge_uses
from mixpinn.records.vtk_file import write_vtk

_SMALLEST, _SMALL, _LARGEST, _OFF, _FACE = 2.0, 8.0, 1000.0, 3.0, 5.0
"""Lengths that a probe has, that few have, how far its tip may be from the origin, and how high it is closed [mm]."""


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

        Triangles that face the other way than their neighbours are turned.

        Raises:
            InputError: absent, unreadable or without triangles.
        """
        path = Path(path)
        points, triangles = read_surface(path, expected="a triangle surface (.stl)", fix="export it as STL again")
        return Probe(points, triangles, path.stem)


def check_probe(probe: Probe) -> tuple[str, ...]:
    """Check that a surface is a probe as the protocol means it: in mm, its tip at the origin, pointing to −y.

    Returns:
        What a user should know: that it is so small that its lengths may be centimetres or inches, that it has a hole
        where it presses, comes in pieces, or has valleys that skin may lie in.

    Raises:
        InputError: it is too small or too large for a probe, lies beside the origin, stands on its head, or lies on
            its side.
    """
    low, high = probe.points.min(axis=0), probe.points.max(axis=0)
    extent = float((high - low).max())
    if not _SMALLEST <= extent <= _LARGEST:
        unit = "metres" if extent < _SMALLEST else "micrometres"
        raise InputError(
            probe.name, expected="a probe of some centimetres, in mm", got=f"a surface {extent:.3g} mm long: {unit}?",
            fix="export it in mm",
        )
    if low[1] < -_OFF and abs(high[1]) <= _OFF:
        raise InputError(
            probe.name, expected="a probe that points to −y", got="one that stands on its head, its tip pointing to +y",
            fix="turn it by 180° about z",
        )
    tip = probe.points[probe.points[:, 1] <= low[1] + _OFF][:, [0, 2]]
    beside = np.maximum(tip.min(axis=0), 0.0) + np.minimum(tip.max(axis=0), 0.0)
    place = np.array([beside[0], low[1], beside[1]])
    if (np.abs(place) > _OFF).any():
        x, y, z = place
        raise InputError(
            probe.name, expected="the tip at the origin, pointing to −y",
            got=f"its lowest points {np.linalg.norm(place):.0f} mm away from it (x {x:.0f}, y {y:.0f}, z {z:.0f})",
            fix="move the tip to the origin and turn the probe so that it points to −y (x right, z along the body)",
        )
    return tuple(_oddities(probe, extent))


def _oddities(probe: Probe, extent: float) -> Iterator[str]:
    if extent < _SMALL:
        yield f"the probe is {extent:.3g} mm long: are its lengths centimetres or inches?"
    edges, faces, _ = edge_uses(probe.triangles)
    rim = edges[faces == 1]
    height = float(probe.points[rim, 1].min() - probe.points[:, 1].min()) if len(rim) else np.inf
    if height < _FACE:
        yield f"the probe has a hole {height:.1f} mm above its tip: nothing is pressed there"
    graph = coo_matrix((np.ones(len(edges)), edges.T), shape=(len(probe.points), len(probe.points)))
    used = np.unique(probe.triangles)
    pieces = len(np.unique(connected_components(graph, directed=False)[1][used]))
    if pieces > 1:
        yield f"the probe comes in {pieces} pieces: each of them presses"
    if told := valley_warning(probe.points, probe.triangles):
        yield told


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
