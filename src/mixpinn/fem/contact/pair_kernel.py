"""Compiled evaluation of contact on a patch of skin: energy, gradient and dense stiffness in one pass.

Distance of a point p to a triangle with vertices x_i, nearest place q = Σ w_i x_i, e = q − p, d = |e|, n = e / d.
Where q moves within the span of the m edges T_k (m = 2 inside the triangle, 1 on an edge, 0 at a vertex), the
implicit function theorem applied to T_k · e = 0 gives, with M_kl = T_k · T_l and c_ki = ±1 where vertex i is the
tip or the base of T_k (0 elsewhere),

    ∂d/∂x_i = w_i n,
    ∂²(d²/2)/∂x_i ∂x_j = w_i w_j 1 − Σ_kl (M⁻¹)_kl (w_i T_k + c_ki e)(w_j T_l + c_lj e)ᵀ,
    ∂²d/∂x_i ∂x_j = (∂²(d²/2)/∂x_i ∂x_j − w_i w_j n nᵀ) / d.

A vertex against a fixed triangle is the same with one moving vertex, w = 1 and c = 0.
"""

import numba
import numpy as np

from mixpinn.geometry.proximity import nearest_on_triangle

# mypy cannot see through numba's decorators: the kernels are untyped, their callers are not.


@numba.njit(cache=True)
def _penalty(v, k, delta):  # type: ignore[no-untyped-def]
    """φ, φ' and φ'' of `mixpinn.fem.contact.model`."""
    if v <= 0.0:
        return 0.0, 0.0, 0.0
    if v < delta:
        return k * v**3 / (6.0 * delta), k * v * v / (2.0 * delta), k * v / delta
    return k * (0.5 * v * v - 0.5 * delta * v + delta * delta / 6.0), k * (v - 0.5 * delta), k


@numba.njit(cache=True)
def _spans(feature, corner, edges, tips, bases):  # type: ignore[no-untyped-def]
    """Edges within which the nearest place may move, and the corners at their tips and bases; their number."""
    if feature == 0:
        pairs = ((0, 1), (0, 2))
        m = 2
    elif feature <= 3:
        base = feature % 3
        pairs = ((base, (feature + 1) % 3), (0, 0))
        m = 1
    else:
        return 0
    for k in range(m):
        bases[k], tips[k] = pairs[k]
        for r in range(3):
            edges[k, r] = corner[tips[k], r] - corner[bases[k], r]
    return m


@numba.njit(cache=True)
def _gram_inverse(edges, m, inverse):  # type: ignore[no-untyped-def]
    """Inverse of the m × m matrix of the scalar products of the edges; zero for degenerate ones."""
    a = (edges[0] * edges[0]).sum()
    if m == 1:
        inverse[0, 0] = 1.0 / a if a > 0.0 else 0.0
        return
    b, c = (edges[0] * edges[1]).sum(), (edges[1] * edges[1]).sum()
    determinant = a * c - b * b
    scale = 1.0 / determinant if determinant > 1e-12 * a * c else 0.0
    inverse[0, 0], inverse[1, 1] = scale * c, scale * a
    inverse[0, 1] = inverse[1, 0] = -scale * b


@numba.njit(cache=True)
def evaluate(  # type: ignore[no-untyped-def]
    x, samples, sample_pairs, triangles, corners, vertex_pairs, probe_triangles, gap, k, delta,
    mu, k_slip, anchored, anchor_vertices, anchor_weights, anchor_normal, anchor_offset, exact,
):
    """Contact of placed probe samples and corners with skin vertices `x` (v, 3); see `mixpinn.fem.contact.model`.

    Contact points are the samples followed by the skin vertices. `anchor_offset` is elastic slip at the start minus
    relative position at the start minus the position of the probe's material point, so that e = offset + Σ w x.
    Without `exact` the stiffness lacks N ∂²d and the dependence of friction on N, and is positive semi-definite.

    Returns:
        energy, largest violation, number of active pairs, gradient (v, 3), stiffness (3 v, 3 v), which vertices carry
        any (v,), normal force (p,) and elastic slip (p, 3) of each contact point.
    """
    n_samples, n = len(samples), len(x)
    n_points = n_samples + n
    energy, worst, hits = 0.0, 0.0, 0
    gradient = np.zeros((n, 3))
    hessian = np.zeros((3 * n, 3 * n))
    touched = np.zeros(n, np.bool_)
    force = np.zeros(n_points)
    slip = np.zeros((n_points, 3))
    n_pairs = len(sample_pairs) + len(vertex_pairs)
    # Derivative of each contact point's normal force, as a linked list of its pairs: N' = −φ'' w n.
    last = np.full(n_points, -1)
    link = np.empty(n_pairs, np.int64)
    pair_vertex = np.empty((n_pairs, 3), np.int64)
    pair_slope = np.empty((n_pairs, 3, 3))
    corner, edges, inverse = np.empty((3, 3)), np.zeros((2, 3)), np.zeros((2, 2))
    tips, bases = np.zeros(2, np.int64), np.zeros(2, np.int64)
    weights, vertices = np.empty(3), np.empty(3, np.int64)
    e, direction = np.empty(3), np.empty(3)
    lever = np.empty((2, 3, 3))
    for pair in range(n_pairs):
        by_sample = pair < len(sample_pairs)
        if by_sample:
            key, t = sample_pairs[pair, 0], sample_pairs[pair, 1]
            point = samples[key]
            for i in range(3):
                corner[i] = x[triangles[t, i]]
        else:
            vertex, t = vertex_pairs[pair - len(sample_pairs), 0], vertex_pairs[pair - len(sample_pairs), 1]
            key = n_samples + vertex
            point = x[vertex]
            for i in range(3):
                corner[i] = corners[probe_triangles[t, i]]
        wa, wb, wc, squared, feature = nearest_on_triangle(
            point[0], point[1], point[2], corner[0], corner[1], corner[2],
        )
        distance = np.sqrt(squared)
        phi, push, stiffness = _penalty(gap - distance, k, delta)
        if push == 0.0:
            continue
        hits += 1
        energy += phi
        worst = max(worst, gap - distance)
        force[key] += push
        distance = max(distance, 1e-9)
        m = _spans(feature, corner, edges, tips, bases)
        if m > 0:
            _gram_inverse(edges, m, inverse)
        if by_sample:
            moving = 3
            weights[0], weights[1], weights[2] = wa, wb, wc
            for i in range(3):
                vertices[i] = triangles[t, i]
            for r in range(3):
                e[r] = wa * corner[0, r] + wb * corner[1, r] + wc * corner[2, r] - point[r]
        else:
            moving = 1
            weights[0], weights[1], weights[2] = 1.0, 0.0, 0.0
            vertices[0] = vertex
            for r in range(3):
                e[r] = point[r] - wa * corner[0, r] - wb * corner[1, r] - wc * corner[2, r]
        for r in range(3):
            direction[r] = e[r] / distance
        for kk in range(m):
            for i in range(moving):
                sign = 0.0
                if by_sample:
                    sign = 1.0 if i == tips[kk] else (-1.0 if i == bases[kk] else 0.0)
                for r in range(3):
                    lever[kk, i, r] = weights[i] * edges[kk, r] + sign * e[r]
        link[pair] = last[key]
        last[key] = pair
        for i in range(3):
            pair_vertex[pair, i] = vertices[i] if i < moving else 0
            for r in range(3):
                pair_slope[pair, i, r] = -stiffness * weights[i] * direction[r] if i < moving else 0.0
        bend = push / distance if exact else 0.0
        for i in range(moving):
            if weights[i] != 0.0:
                touched[vertices[i]] = True
            for r in range(3):
                gradient[vertices[i], r] -= push * weights[i] * direction[r]
            for j in range(moving):
                ww = weights[i] * weights[j]
                for r in range(3):
                    for c in range(3):
                        value = (stiffness + bend) * ww * direction[r] * direction[c]
                        if r == c:
                            value -= bend * ww
                        if exact:
                            for kk in range(m):
                                for ll in range(m):
                                    value += bend * inverse[kk, ll] * lever[kk, i, r] * lever[ll, j, c]
                        hessian[3 * vertices[i] + r, 3 * vertices[j] + c] += value
        if exact and m > 0:
            for i in range(moving):
                touched[vertices[i]] = True
    if mu > 0.0 and hits > 0:
        u = np.empty(3)
        for key in range(n_points):
            if force[key] <= 0.0 or not anchored[key]:
                continue
            normal = anchor_normal[key]
            for r in range(3):
                e[r] = anchor_offset[key, r]
                for i in range(3):
                    e[r] += anchor_weights[key, i] * x[anchor_vertices[key, i], r]
            along = e[0] * normal[0] + e[1] * normal[1] + e[2] * normal[2]
            size = 0.0
            for r in range(3):
                e[r] -= along * normal[r]
                size += e[r] * e[r]
            size = np.sqrt(size)
            limit = mu * force[key]
            sticks = k_slip * size <= limit
            if sticks:
                energy += 0.5 * k_slip * size * size
                factor, shrink = k_slip, 0.0
                for r in range(3):
                    u[r], slip[key, r] = 0.0, e[r]
            else:
                energy += limit * (size - 0.5 * limit / k_slip)
                factor, shrink = limit / size, 1.0
                for r in range(3):
                    u[r] = e[r] / size
                    slip[key, r] = limit / k_slip * u[r]
            for i in range(3):
                wi = anchor_weights[key, i]
                if wi == 0.0:
                    continue
                vi = anchor_vertices[key, i]
                touched[vi] = True
                for r in range(3):
                    gradient[vi, r] += k_slip * slip[key, r] * wi
                for j in range(3):
                    wj = anchor_weights[key, j]
                    if wj == 0.0:
                        continue
                    vj = anchor_vertices[key, j]
                    for r in range(3):
                        for c in range(3):
                            value = -normal[r] * normal[c] - shrink * u[r] * u[c]
                            if r == c:
                                value += 1.0
                            hessian[3 * vi + r, 3 * vj + c] += wi * wj * factor * value
                if exact and not sticks:
                    pair = last[key]
                    while pair >= 0:
                        for j in range(3):
                            vj = pair_vertex[pair, j]
                            for r in range(3):
                                for c in range(3):
                                    hessian[3 * vi + r, 3 * vj + c] += wi * mu * u[r] * pair_slope[pair, j, c]
                        pair = link[pair]
    return energy, worst, hits, gradient, hessian, touched, force, slip
