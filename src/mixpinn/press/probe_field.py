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
        return self._evaluated(points)[2]

    def at(self, points: AnyArray) -> tuple[FloatArray, FloatArray]:
        """Distance [mm], shape (p,), and its gradient, shape (p, 3), at points of the probe's frame, shape (p, 3)."""
        return self._evaluated(points)[:2]

    def _evaluated(self, points: AnyArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        points = np.ascontiguousarray(points, dtype=np.float64)
        distance, gradient, bend = np.empty(len(points)), np.empty((len(points), 3)), np.empty((len(points), 3, 3))
        flat, shape = self.coefficients.ravel(), np.array(self.coefficients.shape)
        _evaluate(flat, shape, self.origin, self.spacing, points, distance, gradient, bend)
        return distance, gradient, bend


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
def _spline(t):  # type: ignore[no-untyped-def]
    """The four cubic B-splines around a place at fraction t of its cell."""
    u = 1.0 - t
    return (
        u * u * u / 6.0, (3.0 * t * t * t - 6.0 * t * t + 4.0) / 6.0, (3.0 * u * u * u - 6.0 * u * u + 4.0) / 6.0,
        t * t * t / 6.0,
    )


@numba.njit(cache=True, nogil=True)
def _spline_slope(t):  # type: ignore[no-untyped-def]
    """Their first derivatives."""
    u = 1.0 - t
    return -0.5 * u * u, 1.5 * t * t - 2.0 * t, -1.5 * u * u + 2.0 * u, 0.5 * t * t


@numba.njit(cache=True, nogil=True)
def _spline_bend(t):  # type: ignore[no-untyped-def]
    """Their second derivatives."""
    return 1.0 - t, 3.0 * t - 2.0, 1.0 - 3.0 * t, t


@numba.njit(cache=True, nogil=True, fastmath={"contract"})
def distance_at(coefficients, shape, origin, spacing, place, gradient, bend):  # type: ignore[no-untyped-def]
    """Distance at one place of the probe's frame; fills its gradient (3,) and second derivatives (3, 3).

    Off the grid: `FAR`, and derivatives are zero. `coefficients` are flat, of the given shape. The four coefficients of
    a line lie side by side: their sums over the other two directions are kept apart, four at a time, and joined last.
    """
    a, b, c = (place[0] - origin[0]) / spacing, (place[1] - origin[1]) / spacing, (place[2] - origin[2]) / spacing
    i, j, k = int(np.floor(a)), int(np.floor(b)), int(np.floor(c))
    if i < 1 or j < 1 or k < 1 or i > shape[0] - 3 or j > shape[1] - 3 or k > shape[2] - 3:
        gradient[:] = 0.0
        bend[:] = 0.0
        return FAR
    a, b, c = a - i, b - j, c - k
    u, u1, u2 = _spline(a), _spline_slope(a), _spline_bend(a)
    v, v1, v2 = _spline(b), _spline_slope(b), _spline_bend(b)
    w, w1, w2 = _spline(c), _spline_slope(c), _spline_bend(c)
    a0 = a1 = a2 = a3 = b0 = b1 = b2 = b3 = c0 = c1 = c2 = c3 = 0.0
    d0 = d1 = d2 = d3 = e0 = e1 = e2 = e3 = f0 = f1 = f2 = f3 = 0.0
    for m in range(4):
        p0 = p1 = p2 = p3 = q0 = q1 = q2 = q3 = r0 = r1 = r2 = r3 = 0.0
        for n in range(4):
            at = ((i - 1 + m) * shape[1] + j - 1 + n) * shape[2] + k - 1
            t0, t1 = np.float64(coefficients[at]), np.float64(coefficients[at + 1])
            t2, t3 = np.float64(coefficients[at + 2]), np.float64(coefficients[at + 3])
            g, h, o = v[n], v1[n], v2[n]
            p0, p1, p2, p3 = p0 + g * t0, p1 + g * t1, p2 + g * t2, p3 + g * t3
            q0, q1, q2, q3 = q0 + h * t0, q1 + h * t1, q2 + h * t2, q3 + h * t3
            r0, r1, r2, r3 = r0 + o * t0, r1 + o * t1, r2 + o * t2, r3 + o * t3
        g, h, o = u[m], u1[m], u2[m]
        a0, a1, a2, a3 = a0 + g * p0, a1 + g * p1, a2 + g * p2, a3 + g * p3
        b0, b1, b2, b3 = b0 + h * p0, b1 + h * p1, b2 + h * p2, b3 + h * p3
        c0, c1, c2, c3 = c0 + o * p0, c1 + o * p1, c2 + o * p2, c3 + o * p3
        d0, d1, d2, d3 = d0 + g * q0, d1 + g * q1, d2 + g * q2, d3 + g * q3
        e0, e1, e2, e3 = e0 + h * q0, e1 + h * q1, e2 + h * q2, e3 + h * q3
        f0, f1, f2, f3 = f0 + g * r0, f1 + g * r1, f2 + g * r2, f3 + g * r3
    once = 1.0 / spacing
    twice = once * once
    gradient[0] = once * (w[0] * b0 + w[1] * b1 + w[2] * b2 + w[3] * b3)
    gradient[1] = once * (w[0] * d0 + w[1] * d1 + w[2] * d2 + w[3] * d3)
    gradient[2] = once * (w1[0] * a0 + w1[1] * a1 + w1[2] * a2 + w1[3] * a3)
    bend[0, 0] = twice * (w[0] * c0 + w[1] * c1 + w[2] * c2 + w[3] * c3)
    bend[1, 1] = twice * (w[0] * f0 + w[1] * f1 + w[2] * f2 + w[3] * f3)
    bend[2, 2] = twice * (w2[0] * a0 + w2[1] * a1 + w2[2] * a2 + w2[3] * a3)
    bend[0, 1] = bend[1, 0] = twice * (w[0] * e0 + w[1] * e1 + w[2] * e2 + w[3] * e3)
    bend[0, 2] = bend[2, 0] = twice * (w1[0] * b0 + w1[1] * b1 + w1[2] * b2 + w1[3] * b3)
    bend[1, 2] = bend[2, 1] = twice * (w1[0] * d0 + w1[1] * d1 + w1[2] * d2 + w1[3] * d3)
    return w[0] * a0 + w[1] * a1 + w[2] * a2 + w[3] * a3


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
def _evaluate(coefficients, shape, origin, spacing, points, distance, gradient, bend):  # type: ignore[no-untyped-def]
    for i in range(len(points)):
        distance[i] = distance_at(coefficients, shape, origin, spacing, points[i], gradient[i], bend[i])
