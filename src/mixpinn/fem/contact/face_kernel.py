"""Compiled evaluation of contact integrated over the faces of a patch of skin.

Each point p = Σ w_i x_i of a face, which stands for the area A, has its distance d to the nearest place q of the probe.
Its energy is A φ(g − d) with the penalty φ of `mixpinn.physics.contact_law` per area; with n = (p − q)/d the force on
it is A φ' n, and its stiffness

    A φ'' n nᵀ − A φ' ∂²d,    ∂²d = (1 − n nᵀ − Σ_kl (M⁻¹)_kl T_k T_lᵀ) / d

with the edges T_k within which q moves and their scalar products M (see `mixpinn.fem.contact.pair_kernel`). Friction
acts on the same points. Both reach the nodes by the face's shape functions w_i.
"""

import numba
import numpy as np

from mixpinn.base.arrays import FloatArray
from mixpinn.fem.contact.pair_kernel import edge_spans, gram_inverse
from mixpinn.geometry.proximity import nearest_on_triangle
from mixpinn.physics.contact_law import penalty, return_slip, slip_derivative

# mypy cannot see through numba's decorators: the kernels are untyped, their callers are not.


@numba.njit(cache=True)
def nearest_on_probe(point, candidates, corners, probe_triangles):  # type: ignore[no-untyped-def]
    """Nearest place among some of the probe's triangles: triangle, weights, squared distance, feature."""
    best, wa, wb, wc, squared, feature = -1, 0.0, 0.0, 0.0, np.inf, 0
    for k in range(len(candidates)):
        t = candidates[k]
        a, b, c, s, f = nearest_on_triangle(
            point[0], point[1], point[2], corners[probe_triangles[t, 0]], corners[probe_triangles[t, 1]],
            corners[probe_triangles[t, 2]],
        )
        if s < squared:
            best, wa, wb, wc, squared, feature = t, a, b, c, s, f
    return best, wa, wb, wc, squared, feature


@numba.njit(cache=True)
def nearest_within(point, candidates, corners, probe_triangles, capsules, cutoff):  # type: ignore[no-untyped-def]
    """`nearest_on_probe` for what lies within `cutoff`, where anything does.

    A triangle whose capsule lies farther away than the nearest so far is passed over; see `bounding_capsules`.
    """
    best, wa, wb, wc, squared, feature, distance = -1, 0.0, 0.0, 0.0, np.inf, 0, cutoff
    for k in range(len(candidates)):
        t = candidates[k]
        dx, dy, dz = point[0] - capsules[t, 0], point[1] - capsules[t, 1], point[2] - capsules[t, 2]
        ax, ay, az, half = capsules[t, 3], capsules[t, 4], capsules[t, 5], capsules[t, 6]
        along = dx * ax + dy * ay + dz * az
        beyond = max(abs(along) - half, 0.0)
        apart = dx * dx + dy * dy + dz * dz - along * along + beyond * beyond
        limit = capsules[t, 7] + distance
        if apart > limit * limit:
            continue
        a, b, c, s, f = nearest_on_triangle(
            point[0], point[1], point[2], corners[probe_triangles[t, 0]], corners[probe_triangles[t, 1]],
            corners[probe_triangles[t, 2]],
        )
        if s < squared:
            best, wa, wb, wc, squared, feature = t, a, b, c, s, f
            distance = min(distance, np.sqrt(s) * (1.0 + 1e-12))
    return best, wa, wb, wc, squared, feature


def bounding_capsules(triangles: FloatArray) -> FloatArray:
    """Capsules around triangles (t, 3, 3): all within a radius of a line segment along the longest edge, shape (t, 8).

    A row holds the middle of the segment, its direction, half its length and the radius. Long thin triangles, of which
    the side of a probe is made, fit closely.
    """
    edges = np.roll(triangles, -1, axis=1) - triangles
    lengths = np.linalg.norm(edges, axis=2)
    longest, every = lengths.argmax(axis=1), np.arange(len(triangles))
    length = lengths[every, longest]
    direction = edges[every, longest] / np.maximum(length, 1e-300)[:, None]
    start, apex = triangles[every, longest], triangles[every, (longest + 2) % 3]
    arm = apex - start
    height = arm - np.einsum("tk,tk->t", arm, direction)[:, None] * direction
    radius = 0.5 * np.linalg.norm(height, axis=1) * (1.0 + 1e-9) + 1e-9
    return np.column_stack([start + 0.5 * length[:, None] * direction + 0.5 * height, direction, 0.5 * length, radius])


@numba.njit(cache=True)
def evaluate_faces(  # type: ignore[no-untyped-def]
    x, nodes, weights, area, offsets, candidates, corners, probe_triangles, capsules, law, gap, anchored, anchor_normal,
    anchor_offset, exact,
):
    """Contact of placed probe corners with points of faces between skin vertices `x` (v, 3).

    `nodes` and `weights` (q, w) and `area` (q,) are those of the points, entries offsets[i]:offsets[i + 1] of
    `candidates` the probe triangles that point i may touch, with `capsules` (t, 8) around them; `law` holds
    stiffnesses per area. `anchor_offset` (q, 3) is the elastic slip at the start of the step less where the point's
    partner on the probe has gone since, so that e = offset + p. Without `exact` the stiffness lacks the curvature of
    d and the dependence of friction on the normal force, and is positive semi-definite.

    Returns:
        energy, largest violation, number of active points, gradient (v, 3), stiffness (3 a, 3 a) among the a vertices
        that carry any, which these are (v,), normal force (q,) and elastic slip (q, 3) of each point.
    """
    n_points, width = weights.shape
    energy, worst, hits = 0.0, 0.0, 0
    gradient, touched = np.zeros((len(x), 3)), np.zeros(len(x), np.bool_)
    force, slip = np.zeros(n_points), np.zeros((n_points, 3))
    active, triangle, kind = np.empty(n_points, np.int64), np.empty(n_points, np.int64), np.empty(n_points, np.int64)
    at, place, apart = np.empty((n_points, 3)), np.empty((n_points, 3)), np.empty(n_points)
    point = np.empty(3)
    for i in range(n_points):
        if offsets[i] == offsets[i + 1]:
            continue
        point[:] = 0.0
        for c in range(width):
            for r in range(3):
                point[r] += weights[i, c] * x[nodes[i, c], r]
        t, wa, wb, wc, squared, feature = nearest_within(
            point, candidates[offsets[i]:offsets[i + 1]], corners, probe_triangles, capsules, gap,
        )
        if t < 0 or squared >= gap * gap:
            continue
        a, b, c = probe_triangles[t]
        for r in range(3):
            at[hits, r] = point[r]
            place[hits, r] = wa * corners[a, r] + wb * corners[b, r] + wc * corners[c, r]
        active[hits], triangle[hits], kind[hits], apart[hits] = i, t, feature, np.sqrt(squared)
        hits += 1
        for c in range(width):
            touched[nodes[i, c]] = True
    rank, count = np.empty(len(x), np.int64), 0
    for v in range(len(x)):
        rank[v] = count
        count += touched[v]
    hessian = np.zeros((3 * count, 3 * count))
    corner, edges, inverse = np.empty((3, 3)), np.zeros((2, 3)), np.zeros((2, 2))
    tips, bases = np.zeros(2, np.int64), np.zeros(2, np.int64)
    n, e, u, push_on, local = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty((3, 3))
    for hit in range(hits):
        i, t, feature, distance, point = active[hit], triangle[hit], kind[hit], apart[hit], at[hit]
        phi, slope, curvature = penalty(gap - distance, law.stiffness, law.smoothing)
        phi, slope, curvature = area[i] * phi, area[i] * slope, area[i] * curvature
        energy += phi
        worst = max(worst, gap - distance)
        force[i] = slope
        distance = max(distance, 1e-9)
        for c in range(3):
            corner[c] = corners[probe_triangles[t, c]]
        for r in range(3):
            n[r] = (point[r] - place[hit, r]) / distance
        bend = slope / distance if exact else 0.0
        for r in range(3):
            push_on[r] = -slope * n[r]
            for s in range(3):
                local[r, s] = (curvature + bend) * n[r] * n[s]
            local[r, r] -= bend
        if exact:
            m = edge_spans(feature, corner, edges, tips, bases)
            if m > 0:
                gram_inverse(edges, m, inverse)
            for a in range(m):
                for b in range(m):
                    for r in range(3):
                        for s in range(3):
                            local[r, s] += bend * inverse[a, b] * edges[a, r] * edges[b, s]
        if law.friction > 0.0 and anchored[i]:
            stick, normal = law.slip_stiffness * area[i], anchor_normal[i]
            for r in range(3):
                e[r] = anchor_offset[i, r] + point[r]
            factor, sticks, stored = return_slip(e, normal, law.friction * slope, stick, u)
            energy += stored
            for r in range(3):
                slip[i, r] = factor / stick * e[r]
                push_on[r] += factor * e[r]
                for s in range(3):
                    local[r, s] += factor * slip_derivative(r, s, normal, u)
                    if exact and not sticks:
                        local[r, s] -= law.friction * curvature * u[r] * n[s]
        for c in range(width):
            vc, wr = nodes[i, c], weights[i, c]
            for r in range(3):
                gradient[vc, r] += wr * push_on[r]
            for d in range(width):
                row, column, ww = 3 * rank[vc], 3 * rank[nodes[i, d]], wr * weights[i, d]
                for r in range(3):
                    for s in range(3):
                        hessian[row + r, column + s] += ww * local[r, s]
    return energy, worst, hits, gradient, hessian, touched, force, slip
