"""The direction of Newton's method for contact of a linear body, from the few points that are pushed.

With H = Bᵀ D B, B the weights with which nodes move the pushed points and D the stiffness of each of these, 3 by 3, the
step (1 + H W) dλ = e (`mixpinn.physics.condensed_contact`) is also

    dλ = e − Bᵀ D t,    (1 + S D) t = B W e,    S = B W Bᵀ the compliance of the points,

a system of three unknowns a pushed point in place of three a touched node. The smaller one is solved. For D is block
diagonal, the product S D costs next to nothing, while H W costs as much as the elimination.
"""

import numba
import numpy as np

from mixpinn.physics.condensed_contact import newton_step
from mixpinn.physics.elimination import dot, solve_in_place, symmetric_times

# mypy cannot see through numba's decorators: the kernels are untyped, their callers are not.


@numba.njit(cache=True, nogil=True)
def newton_direction(compliance, contacts, forces, error, change, move):  # type: ignore[no-untyped-def]
    """One step of Newton's method: fills dλ (m,) into `change` and −dy = W dλ (m,) into `move`.

    Args:
        compliance: W of the nodes, shape (m, m), symmetric.
        contacts, forces: `Contacts` of these nodes and the `Forces` of them (`mixpinn.press.step_kernel`).
        error: e, shape (m,).
        change, move: filled, shapes (m,).

    Returns:
        Whether there is such a step; if not, `change` is the error.
    """
    pushed = np.flatnonzero(forces.push > 0.0)
    touched = np.full(len(forces.gradient), False)
    for c in pushed:
        for i in range(contacts.stencil.shape[1]):
            touched[contacts.stencil[c, i]] = True
    if len(pushed) <= touched.sum():
        return _by_points(compliance, contacts, forces.slope, pushed, error, change, move)
    inner, unknowns = _stiffness_of(contacts, forces.slope, pushed, touched)
    return newton_step(compliance, error, inner, unknowns, change, move)


@numba.njit(cache=True, nogil=True)
def resistance(contacts, forces, way, out):  # type: ignore[no-untyped-def]
    """Fills `out` (m,) with H times a way of the nodes (m,) [mm]."""
    out[:] = 0.0
    stencil, weights, push, slope = contacts.stencil, contacts.weights, forces.push, forces.slope
    moved = np.empty(3)
    for c in range(len(push)):
        if push[c] > 0.0:
            moved[:] = 0.0
            for i in range(stencil.shape[1]):
                for r in range(3):
                    moved[r] += weights[c, i] * way[3 * stencil[c, i] + r]
            for r in range(3):
                force = slope[c, r, 0] * moved[0] + slope[c, r, 1] * moved[1] + slope[c, r, 2] * moved[2]
                for i in range(stencil.shape[1]):
                    out[3 * stencil[c, i] + r] += weights[c, i] * force


@numba.njit(cache=True, nogil=True, fastmath={"contract"})
def _by_points(compliance, contacts, slope, pushed, error, change, move):  # type: ignore[no-untyped-def]
    """The step from a system of three unknowns a point."""
    stencil, weights = contacts.stencil, contacts.weights
    width, m, size = stencil.shape[1], len(error), 3 * len(pushed)
    whole = width - width % 3
    answers = np.zeros((size, m))  # B W
    matrix, rhs = np.empty((size, size)), np.empty(size)
    for k in range(len(pushed)):
        c = pushed[k]
        for r in range(3):
            row = answers[3 * k + r]
            for i in range(0, whole, 3):  # faces have three nodes or six
                w0, w1, w2 = weights[c, i], weights[c, i + 1], weights[c, i + 2]
                row0, row1 = compliance[3 * stencil[c, i] + r], compliance[3 * stencil[c, i + 1] + r]
                row2 = compliance[3 * stencil[c, i + 2] + r]
                for j in range(m):
                    row[j] += w0 * row0[j] + w1 * row1[j] + w2 * row2[j]
            for i in range(whole, width):
                w0, row0 = weights[c, i], compliance[3 * stencil[c, i] + r]
                for j in range(m):
                    row[j] += w0 * row0[j]
            rhs[3 * k + r] = dot(row, error)
    for a in range(size):  # S, which is symmetric
        row = answers[a]
        for k in range(a // 3, len(pushed)):
            c = pushed[k]
            s0 = s1 = s2 = 0.0
            for i in range(width):
                w, at = weights[c, i], 3 * stencil[c, i]
                s0 += w * row[at]
                s1 += w * row[at + 1]
                s2 += w * row[at + 2]
            matrix[a, 3 * k] = matrix[3 * k, a] = s0
            matrix[a, 3 * k + 1] = matrix[3 * k + 1, a] = s1
            matrix[a, 3 * k + 2] = matrix[3 * k + 2, a] = s2
    for a in range(size):  # 1 + S D
        into = matrix[a]
        for k in range(len(pushed)):
            c, s0, s1, s2 = pushed[k], into[3 * k], into[3 * k + 1], into[3 * k + 2]
            for q in range(3):
                into[3 * k + q] = s0 * slope[c, 0, q] + s1 * slope[c, 1, q] + s2 * slope[c, 2, q]
        into[a] += 1.0
    for i in range(m):
        change[i] = error[i]
    regular = solve_in_place(matrix, rhs)
    if regular:
        for k in range(len(pushed)):
            c = pushed[k]
            t0, t1, t2 = rhs[3 * k], rhs[3 * k + 1], rhs[3 * k + 2]
            for r in range(3):
                force = slope[c, r, 0] * t0 + slope[c, r, 1] * t1 + slope[c, r, 2] * t2
                for i in range(width):
                    change[3 * stencil[c, i] + r] -= weights[c, i] * force
    symmetric_times(compliance, change, move)
    return regular


@numba.njit(cache=True, nogil=True, fastmath={"contract"})
def _stiffness_of(contacts, slope, pushed, touched):  # type: ignore[no-untyped-def]
    """H among the unknowns of the touched nodes, (3 a, 3 a), and these unknowns, (3 a,)."""
    stencil, weights = contacts.stencil, contacts.weights
    width, local, a = stencil.shape[1], np.empty(len(touched), np.int64), 0
    for node in range(len(touched)):
        if touched[node]:
            local[node] = 3 * a
            a += 1
    stiffness, unknowns = np.zeros((3 * a, 3 * a)), np.empty(3 * a, np.int64)
    for node in range(len(touched)):
        if touched[node]:
            for r in range(3):
                unknowns[local[node] + r] = 3 * node + r
    for c in pushed:
        s00, s01, s02 = slope[c, 0, 0], slope[c, 0, 1], slope[c, 0, 2]
        s10, s11, s12 = slope[c, 1, 0], slope[c, 1, 1], slope[c, 1, 2]
        s20, s21, s22 = slope[c, 2, 0], slope[c, 2, 1], slope[c, 2, 2]
        for i in range(width):
            a, w = local[stencil[c, i]], weights[c, i]
            for j in range(width):
                b, ww = local[stencil[c, j]], w * weights[c, j]
                stiffness[a, b] += ww * s00
                stiffness[a, b + 1] += ww * s01
                stiffness[a, b + 2] += ww * s02
                stiffness[a + 1, b] += ww * s10
                stiffness[a + 1, b + 1] += ww * s11
                stiffness[a + 1, b + 2] += ww * s12
                stiffness[a + 2, b] += ww * s20
                stiffness[a + 2, b + 1] += ww * s21
                stiffness[a + 2, b + 2] += ww * s22
    return stiffness, unknowns
