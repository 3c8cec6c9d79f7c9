"""Nodal forces of the Stable Neo-Hookean material in single precision: the fast path of every prediction.

The law is that of `mixpinn.physics.energies`; the cells are those of `mixpinn.physics.linear_tetrahedron` and
`quadratic_tetrahedron`, which solves use in double precision. Here `LANES` cells go through every formula together, as
processors add and multiply so many numbers at once: arrays hold one number of each cell side by side (`in_lanes`).
Cells are summed at the nodes one after another, without threads and without work arrays that outlive a call: any number
of callers may run it at once, and the result is always the same.

Numba caches each file on its own: after a change of `mixpinn.physics.energies` this file's cache must be renewed too
(touch it, or delete ``__pycache__``).
"""

from typing import Any

import numpy as np
from numba import njit

from mixpinn.base.arrays import AnyArray, Float32Array, Int32Array, IntArray
from mixpinn.physics.energies import stable_stress, stable_stress_beyond_linear
from mixpinn.physics.quadrature import TETRAHEDRON_4

LANES = 16
"""Cells that are worked on together."""
_OWN, _OTHER = (np.float32(value) for value in np.unique(TETRAHEDRON_4.points)[::-1])
"""Barycentric coordinates of each of the four points of the quadrature, for its own vertex and for the other three."""


def in_lanes(values: AnyArray) -> AnyArray:
    """Values of cells (m, k), `LANES` cells side by side, shape (⌈m / `LANES`⌉, k · `LANES`).

    The last places are filled with zeros: a cell of node 0 without volume, which carries no force.
    """
    blocks = -(-len(values) // LANES)
    padded = np.zeros((blocks * LANES, values.shape[1]), dtype=values.dtype)
    padded[: len(values)] = values
    return np.ascontiguousarray(padded.reshape(blocks, LANES, -1).transpose(0, 2, 1)).reshape(blocks, -1)


@njit(fastmath=True, cache=True, nogil=True, error_model="numpy")
def add_stable_forces(
    cells: Int32Array, moved: Float32Array, gradients: Float32Array, constants: Float32Array, out: Float32Array,
) -> None:
    """Add V P G_a [N] of all four nodes of each cell to the nodal forces `out`.

    Args:
        cells: the four nodes, in lanes.
        moved: displacement of the nodes [mm], shape (n, 3).
        gradients: G_1, G_2, G_3 of each cell at rest [1/mm], nine numbers in lanes; the sum of all four is zero.
        constants: μ, λ [N/mm²] and V [mm³] of each cell, in lanes.
        out: shape (n, 3).
    """
    u, f = np.empty(12 * LANES, np.float32), np.empty(9 * LANES, np.float32)
    for block in range(len(cells)):
        nodes, g, c = cells[block], gradients[block], constants[block]
        _gather(nodes, 4, moved, u)
        for e in range(LANES):
            g1, g2, g3 = _three(g, 0, e), _three(g, 1, e), _three(g, 2, e)
            rest = _three(u, 0, e)
            h = _gradient(
                _minus(_three(u, 1, e), rest), g1, _minus(_three(u, 2, e), rest), g2, _minus(_three(u, 3, e), rest), g3,
            )
            stress = _scaled(c[2 * LANES + e], stable_stress(h, c[e], c[LANES + e]))
            _put(f, 0, e, _apply(stress, g1))
            _put(f, 1, e, _apply(stress, g2))
            _put(f, 2, e, _apply(stress, g3))
        for e in range(LANES):
            n0, n1, n2, n3 = nodes[e], nodes[LANES + e], nodes[2 * LANES + e], nodes[3 * LANES + e]
            for i in range(3):
                p, q, r = f[i * LANES + e], f[(3 + i) * LANES + e], f[(6 + i) * LANES + e]
                out[n1, i] += p
                out[n2, i] += q
                out[n3, i] += r
                out[n0, i] -= p + q + r


@njit(fastmath=True, cache=True, nogil=True, error_model="numpy")
def add_quadratic_stable_forces(
    cells: Int32Array, moved: Float32Array, gradients: Float32Array, constants: Float32Array, out: Float32Array,
) -> None:
    """Add ∫ P ∂N_n/∂X [N] of all ten nodes of each cell to the nodal forces `out`, with `TETRAHEDRON_4`.

    The displacement gradient is interpolated between those at the vertices,

        H_a = Σ_b (4 (u_ab − u_a) − (u_b − u_a)) ⊗ G_b,

    and forces follow from the moments S_a = ∫ λ_a P: (4 S_a − Σ_b S_b) G_a at vertices, 4 (S_b G_a + S_a G_b) at
    midpoints (`mixpinn.physics.quadratic_tetrahedron`). The four points of the quadrature lie alike near a vertex each.

    Args:
        cells: vertices and the midpoints of the pairs `LOCAL_PAIRS`, ten nodes in lanes.
        moved, gradients, constants, out: as in `add_stable_forces`.
    """
    u, f = np.empty(30 * LANES, np.float32), np.empty(30 * LANES, np.float32)
    for block in range(len(cells)):
        nodes, g, c = cells[block], gradients[block], constants[block]
        _gather(nodes, 10, moved, u)
        for e in range(LANES):
            h0, h1, h2, h3 = _point_gradients(u, g, e)
            mu, lam = c[e], c[LANES + e]
            p0, p1 = stable_stress(h0, mu, lam), stable_stress(h1, mu, lam)
            p2, p3 = stable_stress(h2, mu, lam), stable_stress(h3, mu, lam)
            _put_forces(f, g, e, c[2 * LANES + e], p0, p1, p2, p3)
        _scatter(nodes, f, out)


@njit(fastmath=True, cache=True, nogil=True, error_model="numpy")
def add_nonlinear_forces(
    blocks: IntArray, weights: Float32Array, cells: Int32Array, moved: Float32Array, gradients: Float32Array,
    constants: Float32Array, out: Float32Array,
) -> None:
    """As `add_quadratic_stable_forces` for some blocks of lanes, less what linear elasticity has, times a weight each.

    Args:
        blocks: which they are, shape (b,).
        weights: of each, shape (b,).
        cells, moved, gradients, constants, out: as there.
    """
    u, f = np.empty(30 * LANES, np.float32), np.empty(30 * LANES, np.float32)
    for chosen in range(len(blocks)):
        block = blocks[chosen]
        nodes, g, c, weight = cells[block], gradients[block], constants[block], weights[chosen]
        _gather(nodes, 10, moved, u)
        for e in range(LANES):
            h0, h1, h2, h3 = _point_gradients(u, g, e)
            mu, lam = c[e], c[LANES + e]
            p0, p1 = stable_stress_beyond_linear(h0, mu, lam), stable_stress_beyond_linear(h1, mu, lam)
            p2, p3 = stable_stress_beyond_linear(h2, mu, lam), stable_stress_beyond_linear(h3, mu, lam)
            _put_forces(f, g, e, weight * c[2 * LANES + e], p0, p1, p2, p3)
        _scatter(nodes, f, out)


_inlined = njit(fastmath=True, cache=True, nogil=True, error_model="numpy", inline="always")
"""Three or nine numbers of a cell each: what is written in them becomes one straight formula for all lanes."""


@_inlined
def _gather(nodes: Any, count: int, moved: Any, u: Any) -> None:
    """Displacements of the `count` nodes of each cell, side by side, into `u` (3 · count · `LANES`)."""
    for n in range(count):
        for e in range(LANES):
            node = nodes[n * LANES + e]
            for i in range(3):
                u[(3 * n + i) * LANES + e] = moved[node, i]


@_inlined
def _point_gradients(u: Any, g: Any, e: int) -> Any:
    """Displacement gradients of a ten-node cell at the four points of the quadrature."""
    near = _OWN - _OTHER
    g1, g2, g3 = _three(g, 0, e), _three(g, 1, e), _three(g, 2, e)
    g0 = _fourth(g1, g2, g3)
    u0, u1, u2, u3 = _three(u, 0, e), _three(u, 1, e), _three(u, 2, e), _three(u, 3, e)
    u01, u02, u03 = _three(u, 4, e), _three(u, 5, e), _three(u, 6, e)
    u12, u13, u23 = _three(u, 7, e), _three(u, 8, e), _three(u, 9, e)
    h0 = _gradient(_ahead(u0, u01, u1), g1, _ahead(u0, u02, u2), g2, _ahead(u0, u03, u3), g3)
    h1 = _gradient(_ahead(u1, u01, u0), g0, _ahead(u1, u12, u2), g2, _ahead(u1, u13, u3), g3)
    h2 = _gradient(_ahead(u2, u02, u0), g0, _ahead(u2, u12, u1), g1, _ahead(u2, u23, u3), g3)
    h3 = _gradient(_ahead(u3, u03, u0), g0, _ahead(u3, u13, u1), g1, _ahead(u3, u23, u2), g2)
    mean = _scaled(_OTHER, _sum(h0, h1, h2, h3))
    return _mixed(mean, near, h0), _mixed(mean, near, h1), _mixed(mean, near, h2), _mixed(mean, near, h3)


@_inlined
def _put_forces(f: Any, g: Any, e: int, volume: Any, p0: Any, p1: Any, p2: Any, p3: Any) -> None:
    """Nodal forces of a ten-node cell from the stresses at the four points of the quadrature."""
    four, quarter, near = np.float32(4.0), np.float32(0.25), _OWN - _OTHER
    share = quarter * volume
    g1, g2, g3 = _three(g, 0, e), _three(g, 1, e), _three(g, 2, e)
    g0 = _fourth(g1, g2, g3)
    total = _scaled(share, _sum(p0, p1, p2, p3))
    # 4 S_a, whose sum is 4 `total`
    four_far, own = _scaled(four * _OTHER, total), four * share * near
    s0, s1 = _mixed(four_far, own, p0), _mixed(four_far, own, p1)
    s2, s3 = _mixed(four_far, own, p2), _mixed(four_far, own, p3)
    _put(f, 0, e, _minus(_apply(s0, g0), _apply(total, g0)))
    _put(f, 1, e, _minus(_apply(s1, g1), _apply(total, g1)))
    _put(f, 2, e, _minus(_apply(s2, g2), _apply(total, g2)))
    _put(f, 3, e, _minus(_apply(s3, g3), _apply(total, g3)))
    _put(f, 4, e, _plus(_apply(s1, g0), _apply(s0, g1)))
    _put(f, 5, e, _plus(_apply(s2, g0), _apply(s0, g2)))
    _put(f, 6, e, _plus(_apply(s3, g0), _apply(s0, g3)))
    _put(f, 7, e, _plus(_apply(s2, g1), _apply(s1, g2)))
    _put(f, 8, e, _plus(_apply(s3, g1), _apply(s1, g3)))
    _put(f, 9, e, _plus(_apply(s3, g2), _apply(s2, g3)))


@_inlined
def _scatter(nodes: Any, f: Any, out: Any) -> None:
    """Add the forces of ten-node cells, side by side in `f`, to those of their nodes."""
    for n in range(10):
        for e in range(LANES):
            node = nodes[n * LANES + e]
            for i in range(3):
                out[node, i] += f[(3 * n + i) * LANES + e]


@_inlined
def _fourth(a: Any, b: Any, c: Any) -> Any:
    """−(a + b + c)."""
    return -(a[0] + b[0] + c[0]), -(a[1] + b[1] + c[1]), -(a[2] + b[2] + c[2])


@_inlined
def _three(rows: Any, n: int, e: int) -> Any:
    """The n-th vector of cell e."""
    return rows[3 * n * LANES + e], rows[(3 * n + 1) * LANES + e], rows[(3 * n + 2) * LANES + e]


@_inlined
def _put(rows: Any, n: int, e: int, v: Any) -> None:
    """The n-th vector of cell e becomes `v`."""
    rows[3 * n * LANES + e], rows[(3 * n + 1) * LANES + e], rows[(3 * n + 2) * LANES + e] = v[0], v[1], v[2]


@_inlined
def _minus(a: Any, b: Any) -> Any:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@_inlined
def _plus(a: Any, b: Any) -> Any:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@_inlined
def _ahead(at: Any, middle: Any, other: Any) -> Any:
    """4 (u_ab − u_a) − (u_b − u_a)."""
    four = np.float32(4.0)
    return (
        four * (middle[0] - at[0]) - (other[0] - at[0]), four * (middle[1] - at[1]) - (other[1] - at[1]),
        four * (middle[2] - at[2]) - (other[2] - at[2]),
    )


@_inlined
def _gradient(x: Any, a: Any, y: Any, b: Any, z: Any, c: Any) -> Any:
    """x ⊗ a + y ⊗ b + z ⊗ c."""
    return (
        x[0] * a[0] + y[0] * b[0] + z[0] * c[0], x[0] * a[1] + y[0] * b[1] + z[0] * c[1],
        x[0] * a[2] + y[0] * b[2] + z[0] * c[2], x[1] * a[0] + y[1] * b[0] + z[1] * c[0],
        x[1] * a[1] + y[1] * b[1] + z[1] * c[1], x[1] * a[2] + y[1] * b[2] + z[1] * c[2],
        x[2] * a[0] + y[2] * b[0] + z[2] * c[0], x[2] * a[1] + y[2] * b[1] + z[2] * c[1],
        x[2] * a[2] + y[2] * b[2] + z[2] * c[2],
    )


@_inlined
def _apply(s: Any, g: Any) -> Any:
    """Nine numbers, row by row, times a vector."""
    return (
        s[0] * g[0] + s[1] * g[1] + s[2] * g[2], s[3] * g[0] + s[4] * g[1] + s[5] * g[2],
        s[6] * g[0] + s[7] * g[1] + s[8] * g[2],
    )


@_inlined
def _sum(a: Any, b: Any, c: Any, d: Any) -> Any:
    """Of four matrices."""
    return (
        a[0] + b[0] + c[0] + d[0], a[1] + b[1] + c[1] + d[1], a[2] + b[2] + c[2] + d[2],
        a[3] + b[3] + c[3] + d[3], a[4] + b[4] + c[4] + d[4], a[5] + b[5] + c[5] + d[5],
        a[6] + b[6] + c[6] + d[6], a[7] + b[7] + c[7] + d[7], a[8] + b[8] + c[8] + d[8],
    )


@_inlined
def _scaled(w: Any, a: Any) -> Any:
    return w * a[0], w * a[1], w * a[2], w * a[3], w * a[4], w * a[5], w * a[6], w * a[7], w * a[8]


@_inlined
def _mixed(a: Any, w: Any, b: Any) -> Any:
    """a + w b."""
    return (
        a[0] + w * b[0], a[1] + w * b[1], a[2] + w * b[2], a[3] + w * b[3], a[4] + w * b[4], a[5] + w * b[5],
        a[6] + w * b[6], a[7] + w * b[7], a[8] + w * b[8],
    )
