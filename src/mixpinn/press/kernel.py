"""Compiled parts of contact from a pose: what a probe meets along its axis, and the law of the contacts found.

A contact ties a place of the skin, Σ w x over at most three vertices, to the probe. Its violation is v = v₀ − n · Σ w x
with the normal n held while the law is solved, its force N = k (v − δ/2), or k v²/(2 δ) for 0 < v < δ. Friction ties a
place of the skin to the point a of the probe that it touched first: with the elastic slip s, the part of Σ w x − a
across n, the force is T = k_t s while k_t |s| ≤ μ N (stick), otherwise μ N s/|s| (slip). Both places are the same at
first touch and part when the skin slides.
"""

import numba
import numpy as np

from mixpinn.geometry.proximity import nearest_on_triangle
from mixpinn.geometry.triangle_search import triangles_within

# mypy cannot see through numba's decorators: the kernels are untyped, their callers are not.


@numba.njit(cache=True)
def cast_along(points, vertices, triangles, axis, nearest, hit, weights, height):  # type: ignore[no-untyped-def]
    """For each point, what the line through it along `axis` meets: of all triangles the one farthest along −axis.

    With `nearest` it is the one farthest along +axis instead. Fills for each point the triangle (−1 for none), the
    barycentric weights, and how far along −axis the place lies from the point [mm].
    """
    first = 0
    for r in range(3):
        if abs(axis[r]) < abs(axis[first]):
            first = r
    helper = np.zeros(3)
    helper[first] = 1.0
    u = np.cross(axis, helper)
    u /= np.sqrt((u * u).sum())
    w = np.cross(axis, u)
    flat_points, flat_vertices = np.empty((len(points), 3)), np.empty((len(vertices), 3))
    for cloud, flat in ((points, flat_points), (vertices, flat_vertices)):
        for i in range(len(cloud)):
            p0, p1, p2 = cloud[i, 0], cloud[i, 1], cloud[i, 2]
            flat[i, 0] = p0 * u[0] + p1 * u[1] + p2 * u[2]
            flat[i, 1] = p0 * w[0] + p1 * w[1] + p2 * w[2]
            flat[i, 2] = -(p0 * axis[0] + p1 * axis[1] + p2 * axis[2])
    hit[:] = -1
    if not len(points):
        return
    sign = 1.0 if nearest else -1.0
    best = np.full(len(points), np.inf)
    x_low, x_high = flat_points[:, 0].min(), flat_points[:, 0].max()
    y_low, y_high = flat_points[:, 1].min(), flat_points[:, 1].max()
    for t in range(len(triangles)):
        a, b, c = flat_vertices[triangles[t, 0]], flat_vertices[triangles[t, 1]], flat_vertices[triangles[t, 2]]
        x0, x1 = min(a[0], b[0], c[0]), max(a[0], b[0], c[0])
        y0, y1 = min(a[1], b[1], c[1]), max(a[1], b[1], c[1])
        if x0 > x_high or x1 < x_low or y0 > y_high or y1 < y_low:
            continue
        area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])
        if abs(area) < 1e-9:
            continue
        for i in range(len(points)):
            x, y = flat_points[i, 0], flat_points[i, 1]
            if x < x0 or x > x1 or y < y0 or y > y1:
                continue
            wb = ((x - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (y - a[1])) / area
            wc = ((b[0] - a[0]) * (y - a[1]) - (x - a[0]) * (b[1] - a[1])) / area
            if wb < -1e-9 or wc < -1e-9 or wb + wc > 1.0 + 1e-9:
                continue
            z = (1.0 - wb - wc) * a[2] + wb * b[2] + wc * c[2]
            if sign * z < best[i]:
                best[i] = sign * z
                hit[i] = t
                weights[i, 0], weights[i, 1], weights[i, 2] = 1.0 - wb - wc, wb, wc
                height[i] = z - flat_points[i, 2]


@numba.njit(cache=True)
def nearest_place(point, vertices, triangles, first, place, weights):  # type: ignore[no-untyped-def]
    """Nearest place of a surface to `point`: fills it and its weights; returns the triangle and the distance [mm].

    `first` is a triangle to begin with; the nearer it is, the fewer others are looked at.
    """
    best, found = np.inf, first
    for k in range(-1, len(triangles)):
        t = first if k < 0 else k
        a, b, c = vertices[triangles[t, 0]], vertices[triangles[t, 1]], vertices[triangles[t, 2]]
        apart = 0.0
        for r in range(3):
            low, high = min(a[r], b[r], c[r]), max(a[r], b[r], c[r])
            beside = max(low - point[r], point[r] - high, 0.0)
            apart += beside * beside
        if apart >= best:
            continue
        wa, wb, wc, squared, _ = nearest_on_triangle(point[0], point[1], point[2], a, b, c)
        if squared < best:
            best, found = squared, t
            weights[0], weights[1], weights[2] = wa, wb, wc
    for r in range(3):
        place[r] = 0.0
        for i in range(3):
            place[r] += weights[i] * vertices[triangles[found, i], r]
    return found, np.sqrt(best)


@numba.njit(cache=True)
def touch_along(start, axis, gap, vertices, triangles, first, point, place, weights):  # type: ignore[no-untyped-def]
    """Move `point` from `start` along `axis` to where a surface is `gap` away; fills the nearest place there.

    Newton's method on the distance, which is convex along a line where the surface is, so that it does not overshoot.

    Returns:
        The triangle, and the distance reached [mm].
    """
    for r in range(3):
        point[r] = start[r]
    t, distance = nearest_place(point, vertices, triangles, first, place, weights)
    for _ in range(6):
        if abs(distance - gap) < 0.01 or distance < 1e-6:
            break
        along = 0.0
        for r in range(3):
            along += axis[r] * (place[r] - point[r]) / distance
        move = (distance - gap) / max(along, 0.25)
        for r in range(3):
            point[r] += move * axis[r]
        t, distance = nearest_place(point, vertices, triangles, t, place, weights)
    return t, distance


@numba.njit(cache=True)
def pair_contacts(  # type: ignore[no-untyped-def]
    samples, corners, probe_triangles, axis, gap, reach, x, triangles, held, held_vertices, held_weights, held_anchor,
):
    """Contacts of one placed probe with the skin at `x`, each by the line along the probe's axis.

    Contact points are the samples, then the skin's vertices. Each is moved along the axis to where the other surface is
    `gap` away: that gives normal, nearest place and, where friction does not hold yet (`held`), the two points that
    touch first.

    Args:
        samples, corners: of the probe, placed [mm].
        axis: unit vector along which the probe presses.
        gap: distance at which contact acts [mm].
        reach: contacts farther from touching than this are left out [mm].
        held, held_vertices, held_weights, held_anchor: of each contact point, the last placed.

    Returns:
        Contact point, normal stencil and weights, friction stencil and weights, normal, v₀, friction point.
    """
    ns, n = len(samples), len(x)
    sample_hit, sample_weights, sample_height = np.empty(ns, np.int64), np.empty((ns, 3)), np.empty(ns)
    vertex_hit, vertex_weights, vertex_height = np.empty(n, np.int64), np.empty((n, 3)), np.empty(n)
    cast_along(samples, x, triangles, axis, False, sample_hit, sample_weights, sample_height)
    cast_along(x, corners, probe_triangles, axis, True, vertex_hit, vertex_weights, vertex_height)
    key = np.empty(ns + n, np.int64)
    stencil, weights = np.empty((ns + n, 3), np.int64), np.empty((ns + n, 3))
    grip, grip_weights = np.empty((ns + n, 3), np.int64), np.empty((ns + n, 3))
    normal, offset, anchor = np.empty((ns + n, 3)), np.empty(ns + n), np.empty((ns + n, 3))
    start, point, place, share = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    towards = -axis
    count = 0
    for i in range(ns + n):
        # The point that moves is lifted well clear of the surface that it met along the axis, and comes back to it:
        # a sample along the axis, a vertex of the skin against it.
        if i < ns:
            if sample_hit[i] < 0 or -sample_height[i] > gap + reach:
                continue
            for r in range(3):
                start[r] = samples[i, r] - (sample_height[i] + 2.0 * gap) * axis[r]
            t, distance = touch_along(start, axis, gap, x, triangles, sample_hit[i], point, place, share)
        else:
            v = i - ns
            if vertex_hit[v] < 0 or vertex_height[v] > gap + reach:
                continue
            for r in range(3):
                start[r] = x[v, r] - (vertex_height[v] - 2.0 * gap) * axis[r]
            t, distance = touch_along(
                start, towards, gap, corners, probe_triangles, vertex_hit[v], point, place, share,
            )
        if abs(distance - gap) > 0.1:
            continue  # too steep to be met along the axis
        key[count] = i
        sign = 1.0 if i < ns else -1.0
        offset[count] = gap
        for r in range(3):
            normal[count, r] = sign * (place[r] - point[r]) / distance
            if i < ns:
                stencil[count, r], weights[count, r] = triangles[t, r], share[r]
                offset[count] += normal[count, r] * samples[i, r]
            else:
                stencil[count, r], weights[count, r] = i - ns, 1.0 if r == 0 else 0.0
                offset[count] += normal[count, r] * place[r]
        for r in range(3):
            if held[i]:
                grip[count, r], grip_weights[count, r] = held_vertices[i, r], held_weights[i, r]
                anchor[count, r] = held_anchor[i, r]
            else:
                grip[count, r], grip_weights[count, r] = stencil[count, r], weights[count, r]
                anchor[count, r] = samples[i, r] + place[r] - point[r] if i < ns else point[r]
        count += 1
    return (
        key[:count].copy(), stencil[:count].copy(), weights[:count].copy(), grip[:count].copy(),
        grip_weights[:count].copy(), normal[:count].copy(), offset[:count].copy(), anchor[:count].copy(),
    )


@numba.njit(cache=True)
def contact_law(  # type: ignore[no-untyped-def]
    x, stencil, weights, grip, grip_weights, normal, offset, anchor, settings, gradient, hessian, touched, force, slip,
):
    """Forces and stiffness of all contacts at skin positions `x`; fills the last five arrays.

    `settings` are k, k_t, μ, δ; `force` is N of each contact and `slip` its elastic slip.
    """
    k, k_t, mu, delta = settings
    gradient[:] = 0.0
    hessian[:] = 0.0
    touched[:] = False
    s, u = np.empty(3), np.empty(3)
    for c in range(len(offset)):
        n = normal[c]
        violation = offset[c]
        for i in range(3):
            for r in range(3):
                violation -= weights[c, i] * n[r] * x[stencil[c, i], r]
        force[c] = 0.0
        slip[c] = 0.0
        if violation <= 0.0:
            continue
        if violation < delta:
            push, slope = k * violation * violation / (2.0 * delta), k * violation / delta
        else:
            push, slope = k * (violation - 0.5 * delta), k
        force[c] = push
        along, size = 0.0, 0.0
        for r in range(3):
            s[r] = -anchor[c, r]
            for i in range(3):
                s[r] += grip_weights[c, i] * x[grip[c, i], r]
            along += s[r] * n[r]
        for r in range(3):
            s[r] -= along * n[r]
            size += s[r] * s[r]
        size = np.sqrt(size)
        sticks = k_t * size <= mu * push
        factor = k_t if sticks else mu * push / size
        for r in range(3):
            u[r] = 0.0 if sticks else s[r] / size
            slip[c, r] = factor / k_t * s[r]
        for i in range(3):
            wi, vi = weights[c, i], stencil[c, i]
            if wi != 0.0:
                touched[vi] = True
                for r in range(3):
                    gradient[vi, r] -= wi * push * n[r]
                for j in range(3):
                    for r in range(3):
                        for q in range(3):
                            hessian[3 * vi + r, 3 * stencil[c, j] + q] += wi * weights[c, j] * slope * n[r] * n[q]
            wi, vi = grip_weights[c, i], grip[c, i]
            if wi == 0.0:
                continue
            touched[vi] = True
            for r in range(3):
                gradient[vi, r] += wi * factor * s[r]
            for j in range(3):
                ww = wi * grip_weights[c, j] * factor
                for r in range(3):
                    for q in range(3):
                        value = (1.0 if r == q else 0.0) - n[r] * n[q] - u[r] * u[q]
                        hessian[3 * vi + r, 3 * grip[c, j] + q] += ww * value
                if not sticks:
                    ww = wi * weights[c, j] * mu * slope
                    for r in range(3):
                        for q in range(3):
                            hessian[3 * vi + r, 3 * stencil[c, j] + q] -= ww * u[r] * n[q]


@numba.njit(cache=True)
def solve_contacts(  # type: ignore[no-untyped-def]
    rest, compliance, start, stencil, weights, grip, grip_weights, normal, offset, anchor, settings, tolerance,
    max_iterations,
):
    """Newton's method on λ = g(y), y = −W λ, for the forces λ on the skin's vertices.

    Normals and stencils are held, so that the law is linear piece by piece and the method ends after few changes of
    what touches and sticks. Each step is shortened until (g − λ)ᵀ W (g − λ) falls.

    Returns:
        λ (3 n,), y (3 n,), normal force (c,) and elastic slip (c, 3) of each contact, whether it converged, iterations.
    """
    m = len(start)
    n = m // 3
    lam = start.copy()
    y = -(compliance @ lam)
    gradient, hessian, touched = np.zeros((n, 3)), np.zeros((m, m)), np.zeros(n, np.bool_)
    force, slip = np.zeros(len(offset)), np.zeros((len(offset), 3))
    contact_law(rest + y.reshape(n, 3), stencil, weights, grip, grip_weights, normal, offset, anchor, settings,
                gradient, hessian, touched, force, slip)
    iteration = 0
    converged = False
    for iteration in range(max_iterations):  # noqa: B007 (read after the loop)
        error = gradient.reshape(m) - lam
        total = np.sqrt((gradient * gradient).sum())
        if np.sqrt((error * error).sum()) <= tolerance * max(total, 1e-3):
            converged = True
            break
        response = compliance @ error
        size = (error * response).sum()
        move, change = -response, error.copy()
        some = 3 * touched.sum()
        if some:
            index = np.empty(some, np.int64)
            at = 0
            for i in range(n):
                if touched[i]:
                    for r in range(3):
                        index[at] = 3 * i + r
                        at += 1
            stiffness, inner, rhs = np.empty((some, some)), np.empty((some, some)), np.empty(some)
            for i in range(some):
                rhs[i] = -response[index[i]]
                for j in range(some):
                    stiffness[i, j] = hessian[index[i], index[j]]
                    inner[i, j] = compliance[index[i], index[j]]
            matrix = inner @ stiffness
            for i in range(some):
                matrix[i, i] += 1.0
            push = stiffness @ np.linalg.solve(matrix, rhs)
            extra = np.zeros(m)
            for i in range(some):
                extra[index[i]] = push[i]
            change += extra
            move -= compliance @ extra
        length, best, least = 1.0, 0.0, np.inf
        for _ in range(8):
            contact_law(rest + (y + length * move).reshape(n, 3), stencil, weights, grip, grip_weights, normal, offset,
                        anchor, settings, gradient, hessian, touched, force, slip)
            rest_error = gradient.reshape(m) - lam - length * change
            left = (rest_error * (compliance @ rest_error)).sum()
            if left < least:
                least, best = left, length
            if left <= (1.0 - 0.2 * length) * size:
                break
            length *= 0.5
        if best != length:
            length = best
            contact_law(rest + (y + length * move).reshape(n, 3), stencil, weights, grip, grip_weights, normal, offset,
                        anchor, settings, gradient, hessian, touched, force, slip)
        y = y + length * move
        lam = lam + length * change
    lam = gradient.reshape(m).copy()
    return lam, y, force, slip, converged, iteration


@numba.njit(cache=True)
def shadowed(samples, vertices, triangles, axis, margin, above):  # type: ignore[no-untyped-def]
    """Whether each triangle comes within `margin` of the shadow that the samples cast along `axis`, shape (t,).

    Samples more than `above` [mm] before all of the surface cast none.
    """
    near = np.zeros(len(triangles), np.bool_)
    first = 0
    for r in range(3):
        if abs(axis[r]) < abs(axis[first]):
            first = r
    helper = np.zeros(3)
    helper[first] = 1.0
    u = np.cross(axis, helper)
    u /= np.sqrt((u * u).sum())
    w = np.cross(axis, u)
    height = -(vertices @ axis)
    top = height.max() + above
    cloud = np.zeros((len(samples), 3))
    count = 0
    for i in range(len(samples)):
        if -(samples[i] * axis).sum() <= top:
            cloud[count, 0], cloud[count, 1] = (samples[i] * u).sum(), (samples[i] * w).sum()
            count += 1
    if not count:
        return near
    flat = np.zeros((len(vertices), 3))
    flat[:, 0], flat[:, 1] = vertices @ u, vertices @ w
    return triangles_within(cloud[:count], flat, triangles, margin)
