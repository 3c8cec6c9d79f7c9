"""Compiled searches over triangles: which come close to points, and on which side of a surface points lie."""

import numba
import numpy as np

from mixpinn.geometry.proximity import nearest_on_triangle

# mypy cannot see through numba's decorators: the kernels are untyped, their callers are not.


@numba.njit(cache=True)
def close_pairs(points, vertices, triangles, cutoff):  # type: ignore[no-untyped-def]
    """All (point, triangle) within `cutoff`; two index arrays."""
    capacity = 4096
    found = np.empty((capacity, 2), np.int64)
    count = 0
    low, high = np.empty(3), np.empty(3)
    for t in range(len(triangles)):
        a, b, c = vertices[triangles[t, 0]], vertices[triangles[t, 1]], vertices[triangles[t, 2]]
        for axis in range(3):
            low[axis] = min(a[axis], b[axis], c[axis]) - cutoff
            high[axis] = max(a[axis], b[axis], c[axis]) + cutoff
        for i in range(len(points)):
            x, y, z = points[i, 0], points[i, 1], points[i, 2]
            if x < low[0] or y < low[1] or z < low[2] or x > high[0] or y > high[1] or z > high[2]:
                continue
            if nearest_on_triangle(x, y, z, a, b, c)[3] > cutoff * cutoff:
                continue
            if count == capacity:
                capacity *= 2
                found = np.concatenate((found, np.empty_like(found)))
            found[count, 0], found[count, 1] = i, t
            count += 1
    return found[:count, 0].copy(), found[:count, 1].copy()


@numba.njit(cache=True)
def triangles_within(points, vertices, triangles, cutoff):  # type: ignore[no-untyped-def]
    """Whether each triangle comes within `cutoff` of any of the points, shape (t,)."""
    near = np.zeros(len(triangles), np.bool_)
    cloud_low, cloud_high = np.empty(3), np.empty(3)
    for axis in range(3):
        cloud_low[axis], cloud_high[axis] = points[:, axis].min() - cutoff, points[:, axis].max() + cutoff
    low, high = np.empty(3), np.empty(3)
    for t in range(len(triangles)):
        a, b, c = vertices[triangles[t, 0]], vertices[triangles[t, 1]], vertices[triangles[t, 2]]
        outside = False
        for axis in range(3):
            low[axis] = min(a[axis], b[axis], c[axis])
            high[axis] = max(a[axis], b[axis], c[axis])
            outside = outside or low[axis] > cloud_high[axis] or high[axis] < cloud_low[axis]
            low[axis] -= cutoff
            high[axis] += cutoff
        if outside:
            continue
        for i in range(len(points)):
            x, y, z = points[i, 0], points[i, 1], points[i, 2]
            if x < low[0] or y < low[1] or z < low[2] or x > high[0] or y > high[1] or z > high[2]:
                continue
            if nearest_on_triangle(x, y, z, a, b, c)[3] <= cutoff * cutoff:
                near[t] = True
                break
    return near


@numba.njit(cache=True)
def points_beneath(points, vertices, triangles):  # type: ignore[no-untyped-def]
    """Whether each point lies behind the place of the surface that is nearest to it.

    The side of an edge or a vertex is that of the mean normal, weighted at vertices by the angles of the triangles
    (J. A. Bærentzen and H. Aanæs, IEEE Transactions on Visualization and Computer Graphics 11, 2005).
    """
    beneath = np.zeros(len(points), np.bool_)
    squared = np.empty(len(triangles))
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        least = np.inf
        for t in range(len(triangles)):
            a, b, c = vertices[triangles[t, 0]], vertices[triangles[t, 1]], vertices[triangles[t, 2]]
            squared[t] = nearest_on_triangle(x, y, z, a, b, c)[3]
            least = min(least, squared[t])
        side = 0.0
        for t in range(len(triangles)):
            if squared[t] > least * (1.0 + 1e-9) + 1e-18:
                continue
            a, b, c = vertices[triangles[t, 0]], vertices[triangles[t, 1]], vertices[triangles[t, 2]]
            wa, wb, wc, _, feature = nearest_on_triangle(x, y, z, a, b, c)
            if feature == 5:
                a, b, c = b, c, a
            elif feature == 6:
                a, b, c = c, a, b
            u, v = b - a, c - a
            normal = np.cross(u, v)
            area = np.sqrt((normal * normal).sum())
            if area == 0.0:
                continue
            weight = np.arctan2(area, (u * v).sum()) if feature >= 4 else 1.0
            corner = vertices[triangles[t]]
            place = wa * corner[0] + wb * corner[1] + wc * corner[2]
            side += weight / area * ((points[i] - place) * normal).sum()
        beneath[i] = side < 0.0
    return beneath


@numba.njit(cache=True)
def points_inside(points, vertices, triangles):  # type: ignore[no-untyped-def]
    """Whether each point lies inside the closed surface: its winding number, Σ solid angles / 4π, exceeds ½.

    Solid angles after A. van Oosterom and J. Strackee, IEEE Transactions on Biomedical Engineering 30, 1983.
    """
    inside = np.zeros(len(points), np.bool_)
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        total = 0.0
        for t in range(len(triangles)):
            i0, i1, i2 = triangles[t, 0], triangles[t, 1], triangles[t, 2]
            a0, a1, a2 = vertices[i0, 0] - x, vertices[i0, 1] - y, vertices[i0, 2] - z
            b0, b1, b2 = vertices[i1, 0] - x, vertices[i1, 1] - y, vertices[i1, 2] - z
            c0, c1, c2 = vertices[i2, 0] - x, vertices[i2, 1] - y, vertices[i2, 2] - z
            la = np.sqrt(a0 * a0 + a1 * a1 + a2 * a2)
            lb = np.sqrt(b0 * b0 + b1 * b1 + b2 * b2)
            lc = np.sqrt(c0 * c0 + c1 * c1 + c2 * c2)
            numerator = a0 * (b1 * c2 - b2 * c1) + a1 * (b2 * c0 - b0 * c2) + a2 * (b0 * c1 - b1 * c0)
            denominator = (
                la * lb * lc + (a0 * b0 + a1 * b1 + a2 * b2) * lc + (b0 * c0 + b1 * c1 + b2 * c2) * la
                + (c0 * a0 + c1 * a1 + c2 * a2) * lb
            )
            total += 2.0 * np.arctan2(numerator, denominator)
        inside[i] = total > 2.0 * np.pi
    return inside
