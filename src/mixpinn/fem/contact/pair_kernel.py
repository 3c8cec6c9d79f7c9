"""Compiled evaluation of contact on a patch of skin: energy, gradient and dense stiffness in one pass.

Distance of a point p to a triangle with vertices x_i, nearest place q = Σ w_i x_i, e = q − p, d = |e|, n = e / d.
Where q moves within the span of the m edges T_k (m = 2 inside the triangle, 1 on an edge, 0 at a vertex), the
implicit function theorem applied to T_k · e = 0 gives, with M_kl = T_k · T_l and c_ki = ±1 where vertex i is the
tip or the base of T_k (0 elsewhere),

    ∂d/∂x_i = w_i n,
    ∂²(d²/2)/∂x_i ∂x_j = w_i w_j 1 − Σ_kl (M⁻¹)_kl (w_i T_k + c_ki e)(w_j T_l + c_lj e)ᵀ,
    ∂²d/∂x_i ∂x_j = (∂²(d²/2)/∂x_i ∂x_j − w_i w_j n nᵀ) / d.

A vertex against a fixed triangle is the same with one moving vertex, w = 1 and c = 0. The laws of the normal force and
of friction are those of `mixpinn.physics.contact_law`.
"""

from typing import NamedTuple

import numba
import numpy as np

from mixpinn.base.arrays import BoolArray, FloatArray, IntArray
from mixpinn.geometry.proximity import nearest_on_triangle
from mixpinn.physics.contact_law import penalty, return_slip, slip_derivative

# mypy cannot see through numba's decorators: the kernels are untyped, their callers are not.


class Pairs(NamedTuple):
    """The placed probe, a patch of skin, and the pairs of them that may touch.

    Attributes:
        samples: of the probe, placed [mm], shape (s, 3).
        corners: vertices of the probe, placed [mm], shape (c, 3).
        probe_triangles: of the probe by corner, shape (t, 3).
        triangles: of the patch by vertex, shape (u, 3).
        of_samples: sample and triangle of the patch, shape (a, 2).
        of_vertices: vertex of the patch and triangle of the probe, shape (b, 2).
    """

    samples: FloatArray
    corners: FloatArray
    probe_triangles: IntArray
    triangles: IntArray
    of_samples: IntArray
    of_vertices: IntArray


class Anchors(NamedTuple):
    """What friction refers to, for each contact point: the samples, then the vertices of the patch; p of them.

    Attributes:
        anchored: whether friction holds it, shape (p,).
        vertices, weights: the place of the skin, shapes (p, 3).
        normal: unit normal from probe to skin, shape (p, 3).
        offset: elastic slip at the start, less relative position at the start, less the position of the probe's
            material point [mm], shape (p, 3): the slip is offset + Σ w x.
    """

    anchored: BoolArray
    vertices: IntArray
    weights: FloatArray
    normal: FloatArray
    offset: FloatArray


class _Sums(NamedTuple):
    """What contact adds up to on the patch: gradient (v, 3), stiffness (3 v, 3 v), and which vertices it touches."""

    gradient: FloatArray
    hessian: FloatArray
    touched: BoolArray


class _Slopes(NamedTuple):
    """Derivative of each contact point's normal force, N' = −φ'' w n, as a linked list of its pairs."""

    last: IntArray
    link: IntArray
    vertex: IntArray
    slope: FloatArray


class _Pair(NamedTuple):
    """Work space for one pair: its triangle, the vertices that move and their weights, e and n, spans and levers."""

    corner: FloatArray
    vertices: IntArray
    weights: FloatArray
    apart: FloatArray
    direction: FloatArray
    edges: FloatArray
    inverse: FloatArray
    tips: IntArray
    bases: IntArray
    lever: FloatArray
    turned: FloatArray


@numba.njit(cache=True)
def edge_spans(feature, corner, edges, tips, bases):  # type: ignore[no-untyped-def]
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
def gram_inverse(edges, m, inverse):  # type: ignore[no-untyped-def]
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


@numba.njit(cache=True, inline="always")
def _moving_vertices(by_sample, first, t, point, triangles, nearest, pair):  # type: ignore[no-untyped-def]
    """Fill vertices, weights and e of a touching pair; returns how many vertices move."""
    wa, wb, wc = nearest
    if by_sample:
        pair.weights[0], pair.weights[1], pair.weights[2] = wa, wb, wc
        for i in range(3):
            pair.vertices[i] = triangles[t, i]
        for r in range(3):
            pair.apart[r] = wa * pair.corner[0, r] + wb * pair.corner[1, r] + wc * pair.corner[2, r] - point[r]
        return 3
    pair.weights[0], pair.weights[1], pair.weights[2] = 1.0, 0.0, 0.0
    pair.vertices[0] = first
    for r in range(3):
        pair.apart[r] = point[r] - wa * pair.corner[0, r] - wb * pair.corner[1, r] - wc * pair.corner[2, r]
    return 1


@numba.njit(cache=True, inline="always")
def _levers(by_sample, moving, m, pair):  # type: ignore[no-untyped-def]
    """Fill the levers L_ki = w_i T_k + c_ki e of every span and moving vertex, and Σ_l (M⁻¹)_kl L_lj."""
    edges, inverse, lever, turned = pair.edges, pair.inverse, pair.lever, pair.turned
    weights, apart, tips, bases = pair.weights, pair.apart, pair.tips, pair.bases
    if m > 0:
        gram_inverse(edges, m, inverse)
    for k in range(m):
        for i in range(moving):
            sign = 0.0
            if by_sample:
                sign = 1.0 if i == tips[k] else (-1.0 if i == bases[k] else 0.0)
            for r in range(3):
                lever[k, i, r] = weights[i] * edges[k, r] + sign * apart[r]
    for k in range(m):
        for i in range(moving):
            for r in range(3):
                total = 0.0
                for n in range(m):
                    total += inverse[k, n] * lever[n, i, r]
                turned[k, i, r] = total


@numba.njit(cache=True, inline="always")
def _add_normal(pair, moving, m, push, stiffness, bend, sums):  # type: ignore[no-untyped-def]
    """Add force and stiffness of a touching pair; `bend` is N / d and m the spans where it holds ∂²d, else zero."""
    weights, vertices, direction, lever, turned = pair.weights, pair.vertices, pair.direction, pair.lever, pair.turned
    gradient, hessian, touched = sums.gradient, sums.hessian, sums.touched
    for i in range(moving):
        wi, vi = weights[i], vertices[i]
        if wi != 0.0 or m > 0:
            touched[vi] = True
        for r in range(3):
            gradient[vi, r] -= push * wi * direction[r]
        for j in range(moving):
            ww, vj = wi * weights[j], vertices[j]
            for r in range(3):
                for c in range(3):
                    value = (stiffness + bend) * ww * direction[r] * direction[c]
                    if r == c:
                        value -= bend * ww
                    for k in range(m):
                        value += bend * lever[k, i, r] * turned[k, j, c]
                    hessian[3 * vi + r, 3 * vj + c] += value


@numba.njit(cache=True, inline="always")
def _add_friction(key, x, anchors, push, law, exact, slopes, sums, slip, e, u):  # type: ignore[no-untyped-def]
    """Add force and stiffness of friction at a contact point that carries `push`; fills its `slip`, returns energy."""
    normal, weights, vertices = anchors.normal[key], anchors.weights[key], anchors.vertices[key]
    gradient, hessian, touched = sums.gradient, sums.hessian, sums.touched
    for r in range(3):
        e[r] = anchors.offset[key, r]
        for i in range(3):
            e[r] += weights[i] * x[vertices[i], r]
    factor, sticks, energy = return_slip(e, normal, law.friction * push, law.slip_stiffness, u)
    for r in range(3):
        slip[r] = factor / law.slip_stiffness * e[r]
    for i in range(3):
        wi, vi = weights[i], vertices[i]
        if wi == 0.0:
            continue
        touched[vi] = True
        for r in range(3):
            gradient[vi, r] += wi * factor * e[r]
        for j in range(3):
            wj, vj = weights[j], vertices[j]
            if wj == 0.0:
                continue
            for r in range(3):
                for c in range(3):
                    hessian[3 * vi + r, 3 * vj + c] += wi * wj * factor * slip_derivative(r, c, normal, u)
        if exact and not sticks:
            pair = slopes.last[key]
            while pair >= 0:
                for j in range(3):
                    vj = slopes.vertex[pair, j]
                    for r in range(3):
                        for c in range(3):
                            hessian[3 * vi + r, 3 * vj + c] += wi * law.friction * u[r] * slopes.slope[pair, j, c]
                pair = slopes.link[pair]
    return energy


@numba.njit(cache=True)
def evaluate(x, pairs, anchors, law, gap, exact):  # type: ignore[no-untyped-def]
    """Contact of placed probe samples and corners with skin vertices `x` (v, 3) [mm].

    Without `exact` the stiffness lacks N ∂²d and the dependence of friction on N, and is positive semi-definite.

    Args:
        x: vertices of the patch [mm], shape (v, 3).
        pairs: `Pairs`.
        anchors: `Anchors`.
        law: `ContactConstants`.
        gap: distance at which contact acts [mm].
        exact: see above.

    Returns:
        energy, largest violation, number of active pairs, gradient (v, 3), stiffness (3 v, 3 v), which vertices carry
        any (v,), normal force (p,) and elastic slip (p, 3) of each contact point.
    """
    n_samples, n, n_first = len(pairs.samples), len(x), len(pairs.of_samples)
    n_points, n_pairs = n_samples + n, n_first + len(pairs.of_vertices)
    energy, worst, hits = 0.0, 0.0, 0
    sums = _Sums(np.zeros((n, 3)), np.zeros((3 * n, 3 * n)), np.zeros(n, np.bool_))
    force, slip = np.zeros(n_points), np.zeros((n_points, 3))
    slopes = _Slopes(
        np.full(n_points, -1), np.empty(n_pairs, np.int64), np.zeros((n_pairs, 3), np.int64), np.zeros((n_pairs, 3, 3)),
    )
    pair = _Pair(
        np.empty((3, 3)), np.empty(3, np.int64), np.empty(3), np.empty(3), np.empty(3), np.zeros((2, 3)),
        np.zeros((2, 2)), np.zeros(2, np.int64), np.zeros(2, np.int64), np.empty((2, 3, 3)),
        np.empty((2, 3, 3)),
    )
    corner = pair.corner
    for index in range(n_pairs):
        by_sample = index < n_first
        if by_sample:
            first, t = pairs.of_samples[index, 0], pairs.of_samples[index, 1]
            key, point = first, pairs.samples[first]
            for i in range(3):
                corner[i] = x[pairs.triangles[t, i]]
        else:
            first, t = pairs.of_vertices[index - n_first, 0], pairs.of_vertices[index - n_first, 1]
            key, point = n_samples + first, x[first]
            for i in range(3):
                corner[i] = pairs.corners[pairs.probe_triangles[t, i]]
        wa, wb, wc, squared, feature = nearest_on_triangle(
            point[0], point[1], point[2], corner[0], corner[1], corner[2],
        )
        distance = np.sqrt(squared)
        phi, push, stiffness = penalty(gap - distance, law.stiffness, law.smoothing)
        if push == 0.0:
            continue
        hits += 1
        energy += phi
        worst = max(worst, gap - distance)
        force[key] += push
        distance = max(distance, 1e-9)
        moving = _moving_vertices(by_sample, first, t, point, pairs.triangles, (wa, wb, wc), pair)
        for r in range(3):
            pair.direction[r] = pair.apart[r] / distance
        slopes.link[index], slopes.last[key] = slopes.last[key], index
        for i in range(moving):
            slopes.vertex[index, i] = pair.vertices[i]
            for r in range(3):
                slopes.slope[index, i, r] = -stiffness * pair.weights[i] * pair.direction[r]
        m, bend = 0, 0.0
        if exact:
            m, bend = edge_spans(feature, corner, pair.edges, pair.tips, pair.bases), push / distance
            _levers(by_sample, moving, m, pair)
        _add_normal(pair, moving, m, push, stiffness, bend, sums)
    if law.friction > 0.0 and hits > 0:
        e, u = np.empty(3), np.empty(3)
        for key in range(n_points):
            if force[key] > 0.0 and anchors.anchored[key]:
                energy += _add_friction(key, x, anchors, force[key], law, exact, slopes, sums, slip[key], e, u)
    return energy, worst, hits, sums.gradient, sums.hessian, sums.touched, force, slip
