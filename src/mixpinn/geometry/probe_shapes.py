"""Built-in tools: where no probe surface is at hand."""

import numpy as np

from mixpinn.base.arrays import FloatArray, IntArray
from mixpinn.base.errors import InputError
from mixpinn.records import Probe

_VALLEY = 1e-9
"""How far above the plane of the triangle beside it a vertex may lie [mm]."""


def linear_probe(
    *, length: float = 57.0, width: float = 16.0, height: float = 40.0, radius: float = 5.0, spacing: float = 3.0,
) -> Probe:
    """A linear ultrasound transducer: a closed box with rounded edges, its face on the plane y = 0, pointing to −y.

    Args:
        length: extent along x [mm].
        width: extent along z [mm].
        height: extent along y [mm].
        radius: of the rounded edges [mm].
        spacing: of the surface's vertices [mm].

    Raises:
        InputError: a size is not positive, or the radius exceeds half the smallest of them.

    Example:
        >>> probe = linear_probe()
        >>> float(probe.points[:, 1].min())
        0.0
    """
    if min(length, width, height, spacing, radius) <= 0.0 or 2.0 * radius > min(length, width, height):
        raise InputError(
            "probe", expected="positive sizes and a radius of at most half the smallest",
            got=f"length {length}, width {width}, height {height}, radius {radius}", fix="change the sizes",
        )
    size = np.array([length, height, width])
    points, triangles = _box_surface(size, spacing)
    # Each point of the box moves to the sphere of `radius` around the nearest point of the box shrunk by `radius`.
    core = np.clip(points, radius, size - radius)
    outward = points - core
    points = core + radius * outward / np.linalg.norm(outward, axis=1, keepdims=True)
    points -= [0.5 * length, 0.0, 0.5 * width]
    import pyvista as pv

    surface = pv.PolyData.from_regular_faces(points, triangles).clean(tolerance=1e-6, absolute=True)
    corners = np.asarray(surface.points, dtype=np.float64)
    return Probe(corners, _without_valleys(corners, surface.regular_faces.astype(np.int64)), "linear probe")


def spherical_probe(*, radius: float = 15.0, subdivisions: int = 4) -> Probe:
    """A sphere of `radius` [mm] that touches the plane y = 0 from above with its lowest point at the origin."""
    import pyvista as pv

    sphere = pv.Icosphere(radius=radius, nsub=subdivisions, center=(0.0, radius, 0.0))
    return Probe(
        np.asarray(sphere.points, dtype=np.float64), sphere.regular_faces.astype(np.int64), "spherical probe",
    )


def _without_valleys(points: FloatArray, triangles: IntArray) -> IntArray:
    """Triangles (t, 3) of a closed surface with the vertices of a convex body (p, 3), none of its edges a valley.

    In a valley, however shallow, the nearest place of the surface jumps from one side to the other, and with it the
    direction of contact. The two triangles at such an edge are replaced by those at the other diagonal of the four
    vertices, which raises the surface.
    """
    triangles = triangles.copy()
    for _ in range(len(triangles)):  # each pass raises the surface; a few are enough
        start, end = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
        apex, owner = np.roll(triangles, -2, axis=1).ravel(), np.repeat(np.arange(len(triangles)), 3)
        forth, back = start * len(points) + end, end * len(points) + start
        order = np.argsort(forth)
        twin = order[np.searchsorted(forth, back, sorter=order)]
        normal = np.cross(points[end] - points[start], points[apex] - points[start])
        rise = np.einsum("ek,ek->e", normal, points[apex[twin]] - points[start]) / np.linalg.norm(normal, axis=1)
        free = np.ones(len(triangles), dtype=bool)
        valleys = np.flatnonzero(rise > _VALLEY)
        for edge in valleys[np.argsort(-rise[valleys], kind="stable")]:
            first, second, other = owner[edge], owner[twin[edge]], apex[twin[edge]]
            if free[first] and free[second]:
                triangles[first] = start[edge], other, apex[edge]
                triangles[second] = other, end[edge], apex[edge]
                free[[first, second]] = False
        if free.all():
            break
    return triangles


def _box_surface(size: FloatArray, spacing: float) -> tuple[FloatArray, IntArray]:
    """Outward triangles of the box [0, size], each face a grid with steps of at most `spacing`."""
    points, triangles = [], []
    count = 0
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        n, m = (max(4, int(np.ceil(size[k] / spacing))) for k in (u, v))
        for side in (0.0, size[axis]):
            grid = np.zeros((n + 1, m + 1, 3))
            grid[..., axis] = side
            grid[..., u] = np.linspace(0.0, size[u], n + 1)[:, None]
            grid[..., v] = np.linspace(0.0, size[v], m + 1)[None, :]
            index = count + np.arange((n + 1) * (m + 1)).reshape(n + 1, m + 1)
            a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]))
            faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
            points.append(grid.reshape(-1, 3))
            triangles.append(faces if side else faces[:, ::-1])
            count += len(points[-1])
    return np.concatenate(points), np.concatenate(triangles)
