"""Where two surfaces come close: locally nearest points of triangles to a cloud of points.

A point may be near several places of a surface at once, for example both faces of a valley. Listed is therefore every
*local* minimum of the distance to the surface: the foot of the perpendicular inside a triangle, a point on an edge that
both adjacent triangles have as their nearest, or a vertex that all incident triangles have as theirs. Places on edges
and vertices are listed once, not once per triangle. Friction chooses its material points among them, and clearances are
measured to them. The normal force of contact is another matter: it counts every pair closer than the gap, local minimum
or not, which keeps it continuous.
"""

from dataclasses import dataclass

import numba
import numpy as np

from mixpinn.base.arrays import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Triangulation:
    """Connectivity of a triangle surface with v vertices and t triangles.

    Attributes:
        triangles: vertex ids, shape (t, 3).
        neighbours: triangle across the edge opposite each corner, −1 at a rim, shape (t, 3).
        incident_offsets, incident: CSR lists of the triangles around each vertex, shapes (v + 1,) and (3 t,).
    """

    triangles: IntArray
    neighbours: IntArray
    incident_offsets: IntArray
    incident: IntArray

    @staticmethod
    def build(triangles: IntArray, n_vertices: int) -> "Triangulation":
        """Connect `triangles`, shape (t, 3); at an edge of more than two triangles only two are linked."""
        triangles = np.ascontiguousarray(triangles, dtype=np.int64)
        corners = [(1, 2), (2, 0), (0, 1)]  # the edge opposite each corner
        ends = np.sort(np.stack([triangles[:, pair] for pair in corners], axis=1).reshape(-1, 2), axis=1)
        order = np.lexsort((ends[:, 1], ends[:, 0]))
        twin = np.full(len(ends), -1, dtype=np.int64)
        same = (ends[order[1:]] == ends[order[:-1]]).all(axis=1)
        first, second = order[:-1][same], order[1:][same]
        twin[first], twin[second] = second // 3, first // 3
        around = np.argsort(triangles.ravel(), kind="stable")
        counts = np.bincount(triangles.ravel(), minlength=n_vertices)
        return Triangulation(
            triangles, twin.reshape(-1, 3), np.concatenate([[0], np.cumsum(counts)]).astype(np.int64), around // 3,
        )


@numba.njit(cache=True, inline="always")
def nearest_on_triangle(px, py, pz, a, b, c):  # type: ignore[no-untyped-def]
    """Nearest point of triangle (a, b, c) to (px, py, pz).

    Returns:
        Barycentric weights, squared distance, and the feature: 0 face, 1–3 the edge opposite corner 0–2, 4–6 the
        vertex at corner 0–2. (C. Ericson, Real-Time Collision Detection, 2005, section 5.1.5.)
    """
    ab0, ab1, ab2 = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    ac0, ac1, ac2 = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    ap0, ap1, ap2 = px - a[0], py - a[1], pz - a[2]
    d1 = ab0 * ap0 + ab1 * ap1 + ab2 * ap2
    d2 = ac0 * ap0 + ac1 * ap1 + ac2 * ap2
    bp0, bp1, bp2 = px - b[0], py - b[1], pz - b[2]
    d3 = ab0 * bp0 + ab1 * bp1 + ab2 * bp2
    d4 = ac0 * bp0 + ac1 * bp1 + ac2 * bp2
    cp0, cp1, cp2 = px - c[0], py - c[1], pz - c[2]
    d5 = ab0 * cp0 + ab1 * cp1 + ab2 * cp2
    d6 = ac0 * cp0 + ac1 * cp1 + ac2 * cp2
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    if d1 <= 0.0 and d2 <= 0.0:
        wa, wb, wc, feature = 1.0, 0.0, 0.0, 4
    elif d3 >= 0.0 and d4 <= d3:
        wa, wb, wc, feature = 0.0, 1.0, 0.0, 5
    elif d6 >= 0.0 and d5 <= d6:
        wa, wb, wc, feature = 0.0, 0.0, 1.0, 6
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        wb = d1 / (d1 - d3)
        wa, wc, feature = 1.0 - wb, 0.0, 3
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        wc = d2 / (d2 - d6)
        wa, wb, feature = 1.0 - wc, 0.0, 2
    elif va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        wc = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        wa, wb, feature = 0.0, 1.0 - wc, 1
    else:
        total = va + vb + vc
        wb, wc = vb / total, vc / total
        wa, feature = 1.0 - wb - wc, 0
    q0 = px - (wa * a[0] + wb * b[0] + wc * c[0])
    q1 = py - (wa * a[1] + wb * b[1] + wc * c[1])
    q2 = pz - (wa * a[2] + wb * b[2] + wc * c[2])
    return wa, wb, wc, q0 * q0 + q1 * q1 + q2 * q2, feature


@numba.njit(cache=True)
def _is_listed(p, t, feature, squared, vertices, triangles, neighbours, offsets, incident):  # type: ignore[no-untyped-def]
    """Whether the hit on triangle `t` is a local minimum, and `t` the triangle that lists it."""
    if feature == 0:
        return True
    slack = 1e-9 * squared + 1e-18
    if feature <= 3:
        other = neighbours[t, feature - 1]
        if other < 0:
            return True
        corner = triangles[other]
        hit = nearest_on_triangle(p[0], p[1], p[2], vertices[corner[0]], vertices[corner[1]], vertices[corner[2]])
        return hit[3] > squared + slack or (hit[3] >= squared - slack and t < other)
    vertex = triangles[t, feature - 4]
    for k in range(offsets[vertex], offsets[vertex + 1]):
        other = incident[k]
        if other == t:
            continue
        corner = triangles[other]
        hit = nearest_on_triangle(p[0], p[1], p[2], vertices[corner[0]], vertices[corner[1]], vertices[corner[2]])
        if hit[3] < squared - slack or (hit[3] <= squared + slack and other < t):
            return False
    return True


@numba.njit(cache=True)
def _search(points, vertices, triangles, neighbours, offsets, incident, cutoff):  # type: ignore[no-untyped-def]
    capacity = 1024
    point = np.empty(capacity, np.int64)
    triangle = np.empty(capacity, np.int64)
    weights = np.empty((capacity, 3))
    distance = np.empty(capacity)
    count = 0
    low, high = np.empty(3), np.empty(3)
    for axis in range(3):
        low[axis], high[axis] = points[:, axis].min() - cutoff, points[:, axis].max() + cutoff
    # Only triangles near the cloud as a whole are looked at again for each point.
    near = np.empty(len(triangles), np.int64)
    boxes = np.empty((len(triangles), 6))
    n_near = 0
    for t in range(len(triangles)):
        a, b, c = vertices[triangles[t, 0]], vertices[triangles[t, 1]], vertices[triangles[t, 2]]
        inside = True
        for axis in range(3):
            lo, hi = min(a[axis], b[axis], c[axis]), max(a[axis], b[axis], c[axis])
            boxes[n_near, axis], boxes[n_near, 3 + axis] = lo - cutoff, hi + cutoff
            inside = inside and lo <= high[axis] and hi >= low[axis]
        if inside:
            near[n_near] = t
            n_near += 1
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        for k in range(n_near):
            box = boxes[k]
            if x < box[0] or y < box[1] or z < box[2] or x > box[3] or y > box[4] or z > box[5]:
                continue
            t = near[k]
            a, b, c = vertices[triangles[t, 0]], vertices[triangles[t, 1]], vertices[triangles[t, 2]]
            wa, wb, wc, squared, feature = nearest_on_triangle(x, y, z, a, b, c)
            if squared > cutoff * cutoff:
                continue
            if not _is_listed(points[i], t, feature, squared, vertices, triangles, neighbours, offsets, incident):
                continue
            if count == capacity:
                capacity *= 2
                point = np.concatenate((point, np.empty_like(point)))
                triangle = np.concatenate((triangle, np.empty_like(triangle)))
                weights = np.concatenate((weights, np.empty_like(weights)))
                distance = np.concatenate((distance, np.empty_like(distance)))
            point[count], triangle[count] = i, t
            weights[count, 0], weights[count, 1], weights[count, 2] = wa, wb, wc
            distance[count] = np.sqrt(squared)
            count += 1
    return point[:count], triangle[:count], weights[:count], distance[:count]


@dataclass(frozen=True, eq=False)
class Proximity:
    """Locally nearest pairs, h in all.

    Attributes:
        point: index of the point, shape (h,).
        triangle: index of the triangle, shape (h,).
        weights: barycentric weights of the nearest place in the triangle, shape (h, 3).
        distance: unsigned distance [mm], shape (h,).
    """

    point: IntArray
    triangle: IntArray
    weights: FloatArray
    distance: FloatArray

    def __len__(self) -> int:
        return len(self.point)


def proximity(
    points: FloatArray, vertices: FloatArray, surface: Triangulation, *, cutoff: float,
) -> Proximity:
    """All local minima of the distance from `points` to a surface that are at most `cutoff`.

    Args:
        points: shape (p, 3) [mm].
        vertices: vertices of the surface, shape (v, 3) [mm].
        surface: connectivity of the surface.
        cutoff: largest distance of interest [mm].
    """
    if not len(points):
        empty = np.empty(0, dtype=np.int64)
        return Proximity(empty, empty, np.empty((0, 3)), np.empty(0))
    return Proximity(*_search(
        np.ascontiguousarray(points), np.ascontiguousarray(vertices), surface.triangles, surface.neighbours,
        surface.incident_offsets, surface.incident, float(cutoff),
    ))
