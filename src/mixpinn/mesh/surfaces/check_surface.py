"""Whether surfaces handed in by the user can bound a volume: closed, and without self-intersections."""

import numba
import numpy as np

from mixpinn.base.arrays import AnyArray, FloatArray, IntArray
from mixpinn.base.errors import InputError
from mixpinn.mesh.surfaces.surface import DomainSurfaces, Surface
from mixpinn.records.triangle_edges import edge_uses


def check_surface(surface: Surface) -> Surface:
    """Return `surface` with its normals outward if it is closed and does not intersect itself.

    Raises:
        InputError: open, branching, inconsistently oriented, self-intersecting, or without volume.
    """
    triangles = surface.triangles
    _, count, along = edge_uses(triangles)
    if (count == 1).any():
        raise InputError(
            surface.name, expected="a closed surface", got=f"an open one with {int((count == 1).sum())} border edges",
            fix="fill its holes",
        )
    if (count > 2).any() or (along != 1).any():
        raise InputError(
            surface.name, expected="a surface with two triangles an edge, oriented alike",
            got="branching edges or triangles turned over", fix="repair it in a mesh editor",
        )
    crossings = self_intersections(surface.points, triangles)
    if len(crossings):
        first = surface.points[triangles[crossings[0, 0]]].mean(axis=0)
        raise InputError(
            surface.name, expected="a surface that does not intersect itself",
            got=f"{len(crossings)} pairs of triangles that cross, the first near {np.round(first, 1).tolist()}",
            fix="repair it in a mesh editor",
        )
    if abs(surface.volume) < 1e-9:
        raise InputError(surface.name, expected="a surface round a volume", got="none inside", fix="check the file")
    return surface if surface.volume > 0.0 else surface.reversed()


def check_surfaces(surfaces: DomainSurfaces) -> DomainSurfaces:
    """Return `surfaces`, each checked by `check_surface`, if the rigid parts lie in the body and apart.

    Raises:
        InputError: as `check_surface`, or two surfaces cross, or a rigid part lies outside the body.
    """
    checked = DomainSurfaces(check_surface(surfaces.body), tuple(check_surface(rigid) for rigid in surfaces.rigid))
    for rigid in checked.rigid:
        if (checked.body.distance(rigid.points) >= 0.0).any():
            raise InputError(
                rigid.name, expected=f"a rigid part inside {checked.body.name}", got="vertices outside it or on it",
                fix="correct the surfaces or their frame",
            )
        others = [other for other in checked.rigid if other is not rigid]
        inside = [other.name for other in others if (other.distance(rigid.points) <= 0.0).any()]
        if inside:
            raise InputError(
                rigid.name, expected="disjoint rigid parts", got=f"an overlap with {inside[0]}",
                fix="separate the surfaces",
            )
    points, triangles = checked.domain()
    if len(self_intersections(points, triangles)):
        raise InputError(
            checked.body.name, expected="surfaces that do not cross", got="crossing triangles",
            fix="separate the surfaces",
        )
    return checked


def self_intersections(points: FloatArray, triangles: IntArray) -> IntArray:
    """Pairs of triangles without a common vertex, of which an edge of one passes through the other; shape (q, 2)."""
    corners = points[triangles]
    low, high = corners.min(axis=1), corners.max(axis=1)
    side = max(float(np.median((high - low).max(axis=1))), float((high - low).max()) / 50.0, 1e-9)
    first = np.floor((low - low.min(axis=0)) / side).astype(np.int64)
    last = np.floor((high - low.min(axis=0)) / side).astype(np.int64)
    triangle, key = _bins(first, last)
    order = np.argsort(key, kind="stable")
    starts = np.flatnonzero(np.diff(key[order], prepend=-1))
    pairs = _crossing_pairs(points, triangles, low, high, triangle[order], np.append(starts, len(order)))
    found: IntArray = np.unique(pairs, axis=0)
    return found


def _bins(first: IntArray, last: IntArray) -> tuple[IntArray, IntArray]:
    """Each triangle once for every grid cell its box touches: triangle and the cell's number."""
    shape = last.max(axis=0) + 1
    extent = last - first + 1
    number = extent.prod(axis=1)
    triangle = np.repeat(np.arange(len(first)), number)
    rank = np.arange(number.sum()) - np.repeat(np.cumsum(number) - number, number)
    cell = np.empty((len(rank), 3), dtype=np.int64)
    for axis in (2, 1, 0):
        cell[:, axis] = first[triangle, axis] + rank % extent[triangle, axis]
        rank //= extent[triangle, axis]
    return triangle, (cell[:, 0] * shape[1] + cell[:, 1]) * shape[2] + cell[:, 2]


@numba.njit(cache=True)
def _pierces(p: AnyArray, q: AnyArray, a: AnyArray, b: AnyArray, c: AnyArray) -> bool:  # pragma: no cover - compiled
    """Whether the segment pq passes through the triangle abc (Möller and Trumbore 1997)."""
    direction, u, v = q - p, b - a, c - a
    normal = np.cross(direction, v)
    determinant = np.dot(u, normal)
    if abs(determinant) < 1e-14:
        return False
    offset = p - a
    s = np.dot(offset, normal) / determinant
    if s < 0.0 or s > 1.0:
        return False
    turned = np.cross(offset, u)
    t = np.dot(direction, turned) / determinant
    if t < 0.0 or s + t > 1.0:
        return False
    along = np.dot(v, turned) / determinant
    return 0.0 <= along <= 1.0


@numba.njit(cache=True)
def _crossing_pairs(
    points: FloatArray, triangles: IntArray, low: FloatArray, high: FloatArray, members: IntArray, starts: IntArray,
) -> IntArray:  # pragma: no cover - compiled
    found = [(np.int64(0), np.int64(0)) for _ in range(0)]
    for b in range(len(starts) - 1):
        for m in range(starts[b], starts[b + 1]):
            for n in range(m + 1, starts[b + 1]):
                i, j = members[m], members[n]
                apart = False
                for axis in range(3):
                    apart |= low[i, axis] > high[j, axis] or low[j, axis] > high[i, axis]
                    for other in range(3):
                        apart |= triangles[i, axis] == triangles[j, other]
                if apart:
                    continue
                for e in range(3):
                    f = (e + 1) % 3
                    if _pierces(
                        points[triangles[i, e]], points[triangles[i, f]], points[triangles[j, 0]],
                        points[triangles[j, 1]], points[triangles[j, 2]],
                    ) or _pierces(
                        points[triangles[j, e]], points[triangles[j, f]], points[triangles[i, 0]],
                        points[triangles[i, 1]], points[triangles[i, 2]],
                    ):
                        found.append((min(i, j), max(i, j)))
                        break
    pairs = np.empty((len(found), 2), dtype=np.int64)
    for row in range(len(found)):
        pairs[row, 0], pairs[row, 1] = found[row]
    return pairs
