"""ProbeField: the distance from a probe's surface on a grid, so that it costs the same whatever the probe.

Between the grid's points the distance is a cubic B-spline through them: twice differentiable, and so are forces that
depend on it. It is positive outside and negative inside; the side is that of the mean normal at the nearest place
(J. A. Bærentzen and H. Aanæs, IEEE Transactions on Visualization and Computer Graphics 11, 2005).
"""

from dataclasses import dataclass
from functools import lru_cache

import numba
import numpy as np
from scipy.ndimage import spline_filter
from scipy.spatial import cKDTree

from mixpinn.base.arrays import AnyArray, Float32Array, FloatArray, IntArray
from mixpinn.geometry.proximity import Triangulation, nearest_on_triangle
from mixpinn.records import Probe

# mypy cannot see through numba's decorators: the kernels are untyped, their callers are not.

FAR = 1e3
"""What counts as the distance of a point off the grid [mm]."""
LINEAR_ERROR = 0.3
"""`distance_about` differs from the distance by less than this part of the grid's spacing."""
_CANDIDATES = 24
"""Triangles that are looked at for the distance of one point of the grid."""
_LARGEST = 1_000_000
"""Points of a grid at most; a large probe gets a coarser one."""


@dataclass(frozen=True, eq=False)
class ProbeField:
    """Signed distance of a probe in its own frame.

    Attributes:
        coefficients: of the cubic B-spline, shape (x, y, z).
        origin: place of the first one [mm], shape (3,).
        spacing: of the grid [mm].
        underside: for each column (x, z) the lowest y at which the distance falls to `gap` [mm], infinite where it
            does nowhere, shape (x, z).
        gap: distance at which contact acts [mm].
        probe: the probe.
    """

    coefficients: Float32Array
    origin: FloatArray
    spacing: float
    underside: FloatArray
    gap: float
    probe: Probe

    @staticmethod
    def of_probe(probe: Probe, *, gap: float, spacing: float = 0.75, margin: float = 5.0) -> "ProbeField":
        """Sample the distance of `probe`.

        Args:
            probe: closed, or open with a rim away from the tip.
            gap: distance at which contact acts [mm].
            spacing: of the grid [mm].
            margin: how far the grid reaches beyond the probe and the gap [mm].
        """
        corners = np.ascontiguousarray(probe.points, dtype=np.float64)
        triangles = np.ascontiguousarray(probe.triangles, dtype=np.int64)
        low, high = corners.min(axis=0) - gap - margin, corners.max(axis=0) + gap + margin
        spacing = max(spacing, float(np.prod(high - low) / _LARGEST) ** (1.0 / 3.0))
        ticks = [np.arange(a, b + spacing, spacing) for a, b in zip(low, high, strict=True)]
        grid = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1)
        distance = signed_distance(grid.reshape(-1, 3), corners, triangles).reshape(grid.shape[:-1])
        return ProbeField(
            spline_filter(distance, order=3, output=np.float64, mode="mirror").astype(np.float32), low, spacing,
            _underside(distance, ticks[1], gap), gap, probe,
        )

    def bend(self, points: AnyArray) -> FloatArray:
        """Second derivatives of the distance [1/mm] at points on the grid, shape (p, 3), shape (p, 3, 3)."""
        points = np.ascontiguousarray(points, dtype=np.float64)
        found = np.empty((len(points), 3, 3))
        flat, shape = self.coefficients.ravel(), np.array(self.coefficients.shape)
        _evaluate_bend(flat, shape, self.origin, self.spacing, points, found)
        return found

    def at(self, points: AnyArray) -> tuple[FloatArray, FloatArray]:
        """Distance [mm], shape (p,), and its gradient, shape (p, 3), at points of the probe's frame, shape (p, 3)."""
        points = np.ascontiguousarray(points, dtype=np.float64)
        distance, gradient = np.empty(len(points)), np.empty((len(points), 3))
        flat, shape = self.coefficients.ravel(), np.array(self.coefficients.shape)
        _evaluate(flat, shape, self.origin, self.spacing, points, distance, gradient)
        return distance, gradient


def signed_distance(points: FloatArray, vertices: FloatArray, triangles: IntArray) -> FloatArray:
    """Distance of points (p, 3) from a surface [mm], negative behind it, shape (p,).

    Args:
        points: [mm], shape (p, 3).
        vertices: of the surface [mm], shape (v, 3).
        triangles: all of one orientation, inwards or outwards: what lies below the lowest vertex is outside.
    """
    surface = Triangulation.build(triangles, len(vertices))
    corners = vertices[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-30)[:, None]
    edges = normal[:, None] + np.where(surface.neighbours[..., None] >= 0, normal[surface.neighbours], 0.0)
    around = np.zeros_like(vertices)
    for k in range(3):
        first, second = corners[:, (k + 1) % 3] - corners[:, k], corners[:, (k + 2) % 3] - corners[:, k]
        sine = np.linalg.norm(np.cross(first, second), axis=1)
        angle = np.arctan2(sine, np.einsum("ij,ij->i", first, second))
        np.add.at(around, triangles[:, k], angle[:, None] * normal)
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    places, owners = [corners.mean(axis=1)], [np.arange(len(triangles))]
    for parts in np.unique(np.ceil(longest / 2.0).astype(np.int64)):
        some = np.flatnonzero(np.ceil(longest / 2.0).astype(np.int64) == parts)
        i, j = np.meshgrid(np.arange(parts + 1), np.arange(parts + 1), indexing="ij")
        kept = i + j <= parts
        weights = np.stack([i[kept], j[kept], parts - i[kept] - j[kept]], axis=1) / max(parts, 1)
        places.append(np.einsum("qc,tck->tqk", weights, corners[some]).reshape(-1, 3))
        owners.append(np.repeat(some, len(weights)))
    tree, owner = cKDTree(np.concatenate(places)), np.concatenate(owners)
    below = np.append(vertices[vertices[:, 1].argmin()] - [0.0, 1.0, 0.0], 0.0)[:3]
    found = np.empty(len(points) + 1)
    asked = np.concatenate([points, below[None]])
    for start in range(0, len(asked), 100_000):
        part = asked[start : start + 100_000]
        near = owner[tree.query(part, k=min(_CANDIDATES, len(owner)))[1]].reshape(len(part), -1)
        _nearest_signed(part, vertices, triangles, near, normal, edges, around, found[start : start + 100_000])
    distance: FloatArray = found[:-1] * np.sign(found[-1])
    return distance


@lru_cache(maxsize=64)
def shadow_columns(field: ProbeField, deepest: float) -> tuple[IntArray, IntArray] | None:
    """First and last columns (x, z) of the grid in which the probe comes below `deepest` [mm]; None where none does."""
    columns = np.argwhere(field.underside < deepest)
    return (columns.min(axis=0), columns.max(axis=0)) if len(columns) else None


def _underside(distance: FloatArray, y: FloatArray, gap: float) -> FloatArray:
    """Where each column of a grid of distances first falls to `gap`, by linear interpolation along y."""
    inside = distance < gap
    first = inside.argmax(axis=1)
    before = np.maximum(first - 1, 0)
    upper = np.take_along_axis(distance, first[:, None], axis=1)[:, 0]
    lower = np.take_along_axis(distance, before[:, None], axis=1)[:, 0]
    share = np.clip((lower - gap) / np.maximum(lower - upper, 1e-12), 0.0, 1.0)
    found: FloatArray = np.where(inside.any(axis=1), y[before] + share * (y[first] - y[before]), np.inf)
    return found


@numba.njit(cache=True, nogil=True)
def _nearest_signed(points, vertices, triangles, near, normal, edges, around, out):  # type: ignore[no-untyped-def]
    """Signed distance of each point from the nearest of its candidate triangles."""
    for i in range(len(points)):
        best, side = np.inf, 1.0
        for k in range(near.shape[1]):
            t = near[i, k]
            a, b, c = vertices[triangles[t, 0]], vertices[triangles[t, 1]], vertices[triangles[t, 2]]
            wa, wb, wc, squared, feature = nearest_on_triangle(points[i, 0], points[i, 1], points[i, 2], a, b, c)
            if squared >= best:
                continue
            best = squared
            if feature == 0:
                n = normal[t]
            elif feature <= 3:
                n = edges[t, feature - 1]
            else:
                n = around[triangles[t, feature - 4]]
            side = 0.0
            for r in range(3):
                side += (points[i, r] - wa * a[r] - wb * b[r] - wc * c[r]) * n[r]
        out[i] = np.sqrt(best) if side >= 0.0 else -np.sqrt(best)


@numba.njit(cache=True, nogil=True)
def _spline(t, value, slope):  # type: ignore[no-untyped-def]
    """The four cubic B-splines around a place at fraction t of its cell, and their derivatives."""
    u = 1.0 - t
    value[0] = u * u * u / 6.0
    value[1] = (3.0 * t * t * t - 6.0 * t * t + 4.0) / 6.0
    value[2] = (3.0 * u * u * u - 6.0 * u * u + 4.0) / 6.0
    value[3] = t * t * t / 6.0
    slope[0] = -0.5 * u * u
    slope[1] = 1.5 * t * t - 2.0 * t
    slope[2] = -1.5 * u * u + 2.0 * u
    slope[3] = 0.5 * t * t


@numba.njit(cache=True, nogil=True)
def distance_at(coefficients, shape, origin, spacing, place, work, gradient):  # type: ignore[no-untyped-def]
    """Distance at one place of the probe's frame; fills its gradient. Off the grid: `FAR`, and no gradient.

    `coefficients` are flat, of the given shape; `work` is (6, 4).
    """
    index0, index1, index2 = 0, 0, 0
    for r in range(3):
        at = (place[r] - origin[r]) / spacing
        cell = int(np.floor(at))
        if cell < 1 or cell > shape[r] - 3:
            gradient[:] = 0.0
            return FAR
        _spline(at - cell, work[2 * r], work[2 * r + 1])
        if r == 0:
            index0 = cell - 1
        elif r == 1:
            index1 = cell - 1
        else:
            index2 = cell - 1
    value, g0, g1, g2 = 0.0, 0.0, 0.0, 0.0
    for i in range(4):
        v0, d0 = work[0, i], work[1, i]
        plane, plane1, plane2 = 0.0, 0.0, 0.0
        for j in range(4):
            line, line2 = 0.0, 0.0
            first = ((index0 + i) * shape[1] + index1 + j) * shape[2] + index2
            for k in range(4):
                c = coefficients[first + k]
                line += work[4, k] * c
                line2 += work[5, k] * c
            plane += work[2, j] * line
            plane1 += work[3, j] * line
            plane2 += work[2, j] * line2
        value += v0 * plane
        g0 += d0 * plane
        g1 += v0 * plane1
        g2 += v0 * plane2
    gradient[0], gradient[1], gradient[2] = g0 / spacing, g1 / spacing, g2 / spacing
    return value


@numba.njit(cache=True, nogil=True)
def distance_bend(coefficients, shape, origin, spacing, place, work, bend):  # type: ignore[no-untyped-def]
    """Second derivatives of the distance at one place on the grid, filled into `bend` (3, 3); operands of the above.

    `work`, (9, 4), holds in its first rows what `distance_at` left there for the same place.
    """
    curve = work[6:]
    index0, index1, index2 = 0, 0, 0
    for r in range(3):
        at = (place[r] - origin[r]) / spacing
        cell = int(np.floor(at))
        t = at - cell
        curve[r, 0], curve[r, 1], curve[r, 2], curve[r, 3] = 1.0 - t, 3.0 * t - 2.0, 1.0 - 3.0 * t, t
        if r == 0:
            index0 = cell - 1
        elif r == 1:
            index1 = cell - 1
        else:
            index2 = cell - 1
    b00, b01, b02, b11, b12, b22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(4):
        plane, plane1, plane2, plane11, plane12, plane22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for j in range(4):
            line, line2, line22 = 0.0, 0.0, 0.0
            first = ((index0 + i) * shape[1] + index1 + j) * shape[2] + index2
            for k in range(4):
                c = coefficients[first + k]
                line += work[4, k] * c
                line2 += work[5, k] * c
                line22 += curve[2, k] * c
            plane += work[2, j] * line
            plane1 += work[3, j] * line
            plane2 += work[2, j] * line2
            plane11 += curve[1, j] * line
            plane12 += work[3, j] * line2
            plane22 += work[2, j] * line22
        b00 += curve[0, i] * plane
        b01 += work[1, i] * plane1
        b02 += work[1, i] * plane2
        b11 += work[0, i] * plane11
        b12 += work[0, i] * plane12
        b22 += work[0, i] * plane22
    scale = 1.0 / (spacing * spacing)
    bend[0, 0], bend[1, 1], bend[2, 2] = b00 * scale, b11 * scale, b22 * scale
    bend[0, 1], bend[0, 2], bend[1, 2] = b01 * scale, b02 * scale, b12 * scale
    bend[1, 0], bend[2, 0], bend[2, 1] = bend[0, 1], bend[0, 2], bend[1, 2]


@numba.njit(cache=True, nogil=True)
def distance_about(coefficients, shape, origin, spacing, place):  # type: ignore[no-untyped-def]
    """About the distance at one place, linear between the spline's coefficients; a tenth of the cost of `distance_at`.

    A spline stays near its coefficients: see `LINEAR_ERROR`. Off the grid: `FAR`.
    """
    a, b, c = (place[0] - origin[0]) / spacing, (place[1] - origin[1]) / spacing, (place[2] - origin[2]) / spacing
    i, j, k = int(np.floor(a)), int(np.floor(b)), int(np.floor(c))
    if i < 1 or j < 1 or k < 1 or i > shape[0] - 3 or j > shape[1] - 3 or k > shape[2] - 3:
        return FAR
    a, b, c = a - i, b - j, c - k
    first = (i * shape[1] + j) * shape[2] + k
    second, plane = first + shape[2], shape[1] * shape[2]
    near = (1.0 - b) * ((1.0 - c) * coefficients[first] + c * coefficients[first + 1])
    near += b * ((1.0 - c) * coefficients[second] + c * coefficients[second + 1])
    first, second = first + plane, second + plane
    far = (1.0 - b) * ((1.0 - c) * coefficients[first] + c * coefficients[first + 1])
    far += b * ((1.0 - c) * coefficients[second] + c * coefficients[second + 1])
    return (1.0 - a) * near + a * far


@numba.njit(cache=True, nogil=True)
def _evaluate(coefficients, shape, origin, spacing, points, distance, gradient):  # type: ignore[no-untyped-def]
    work = np.empty((6, 4))
    for i in range(len(points)):
        distance[i] = distance_at(coefficients, shape, origin, spacing, points[i], work, gradient[i])


@numba.njit(cache=True, nogil=True)
def _evaluate_bend(coefficients, shape, origin, spacing, points, bend):  # type: ignore[no-untyped-def]
    work, gradient = np.empty((9, 4)), np.empty(3)
    for i in range(len(points)):
        distance_at(coefficients, shape, origin, spacing, points[i], work, gradient)
        distance_bend(coefficients, shape, origin, spacing, points[i], work, bend[i])
