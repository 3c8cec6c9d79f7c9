"""The probe's surface as contact sees it: its triangles and a cloud of points on them."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from mixpinn.base.arrays import FloatArray
from mixpinn.geometry.proximity import Triangulation
from mixpinn.records import Probe


@dataclass(frozen=True, eq=False)
class ProbeSurface:
    """The probe's triangles, and points on them closer together than `spacing`.

    Attributes:
        vertices: in the probe's frame [mm], shape (p, 3).
        surface: connectivity.
        samples: points on the surface in the probe's frame [mm], shape (q, 3); the vertices come first.
    """

    vertices: FloatArray
    surface: Triangulation
    samples: FloatArray

    @staticmethod
    def of_probe(probe: Probe, *, spacing: float) -> "ProbeSurface":
        """Sample `probe`: every triangle on a barycentric lattice whose steps are at most `spacing` [mm].

        The skin's nodes may lie farther apart than the probe is wide; samples between the probe's own vertices are
        what keeps an edge of the probe from passing between them.
        """
        corners = probe.points[probe.triangles]
        longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
        clouds = [probe.points]
        for triangle, edge in zip(corners, longest, strict=True):
            n = max(1, int(np.ceil(edge / spacing)))
            i, j = np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij")
            keep = i + j <= n
            weights = np.stack([i[keep], j[keep], n - i[keep] - j[keep]], axis=1) / n
            clouds.append(weights @ triangle)
        return ProbeSurface(
            probe.points, Triangulation.build(probe.triangles, len(probe.points)),
            _thin(np.concatenate(clouds), kept=len(probe.points), distance=0.5 * spacing),
        )


def _thin(points: FloatArray, *, kept: int, distance: float) -> FloatArray:
    """Drop points closer than `distance` to an earlier one; the first `kept` stay in any case."""
    alive = np.ones(len(points), dtype=bool)
    tree = cKDTree(points)
    for index, point in enumerate(points):
        if alive[index]:
            near = np.array(tree.query_ball_point(point, distance), dtype=np.int64)
            alive[near[(near > index) & (near >= kept)]] = False
    return points[alive]
