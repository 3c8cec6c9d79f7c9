"""Contact of an elastic body condensed to the unknowns that contact can touch.

With the elastic residual linearised, r + K Δ, and the contact forces λ(y) on the unknowns c that contact can touch
(y = Δ_c, residual r + K Δ + Sᵀ λ = 0), everything else is eliminated exactly:

    y = y₀ − W λ,    W = S K⁻¹ Sᵀ,    y₀ = −S K⁻¹ r,    λ = g(y).

y₀ is where the body would go without contact, W its compliance. What is left is a small dense problem in which all
contacts switch on and off, stick and slip; it is solved by Newton's method on e = g(y₀ − W λ) − λ = 0,

    (1 + H W) dλ = e,    dy = −W dλ,

with H = ∂g/∂y non-zero only among the unknowns that are touched: `newton_step`, for the solver and for predictions from
the pose alike. How far to go along a step is up to each, since their contacts answer different questions: the solver's
(`solve_condensed`) also give a positive semi-definite H, for where friction and curvature make the exact one
indefinite, and keep the skin on its side of the probe by a largest move; those of `mixpinn.press.step_kernel` are
compiled, know the distance on either side of the probe's skin, and follow the error's square eᵀ W e alone.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numba
import numpy as np

from mixpinn.base.arrays import FloatArray, IntArray
from mixpinn.physics.elimination import dot, solve_in_place, symmetric_times

ContactLaw = Callable[[FloatArray, bool], tuple[FloatArray, FloatArray, IntArray]]
"""g(y, exact): forces (m,), stiffness among the touched unknowns (a, a), and these, (a,).

The stiffness is the derivative of the forces if `exact`, otherwise a symmetric positive semi-definite part of it.
"""


# mypy cannot see through numba's decorators: the kernel is untyped, its callers are not.


@numba.njit(cache=True, nogil=True, fastmath={"contract"})
def _add_three_rows(stiffness, inner, filled, first, matrix):  # type: ignore[no-untyped-def]
    """Add H W to three rows of `matrix`, from columns `filled` of H; what is read of W serves all three."""
    row0, row1, row2 = matrix[first], matrix[first + 1], matrix[first + 2]
    whole = len(filled) - len(filled) % 3
    for k in range(0, whole, 3):
        j0, j1, j2 = filled[k], filled[k + 1], filled[k + 2]
        w0, w1, w2 = inner[j0], inner[j1], inner[j2]
        a0, a1, a2 = stiffness[first, j0], stiffness[first, j1], stiffness[first, j2]
        b0, b1, b2 = stiffness[first + 1, j0], stiffness[first + 1, j1], stiffness[first + 1, j2]
        c0, c1, c2 = stiffness[first + 2, j0], stiffness[first + 2, j1], stiffness[first + 2, j2]
        for c in range(len(row0)):
            row0[c] += a0 * w0[c] + a1 * w1[c] + a2 * w2[c]
            row1[c] += b0 * w0[c] + b1 * w1[c] + b2 * w2[c]
            row2[c] += c0 * w0[c] + c1 * w1[c] + c2 * w2[c]
    for k in range(whole, len(filled)):
        w0 = inner[filled[k]]
        a0, b0, c0 = stiffness[first, filled[k]], stiffness[first + 1, filled[k]], stiffness[first + 2, filled[k]]
        for c in range(len(row0)):
            row0[c] += a0 * w0[c]
            row1[c] += b0 * w0[c]
            row2[c] += c0 * w0[c]


@numba.njit(cache=True, nogil=True, fastmath={"contract"})
def newton_step(compliance, error, stiffness, touched, change, move):  # type: ignore[no-untyped-def]
    """One step of Newton's method: fills dλ (m,) into `change` and −dy = W dλ (m,) into `move`.

    Args:
        compliance: W, shape (m, m), symmetric.
        error: e = g − λ, shape (m,).
        stiffness: H among the touched unknowns, shape (a, a); entries that are zero cost nothing.
        touched: these unknowns, shape (a,).
        change, move: filled, shapes (m,).

    Returns:
        Whether 1 + H W is regular; if not, `change` is the error.
    """
    m, a = len(error), len(touched)
    for i in range(m):
        change[i] = error[i]
    regular = True
    if a:
        # Untouched unknowns follow their error; what that does to the touched ones stands on the right.
        rest, rhs = error.copy(), np.empty(a)
        for i in range(a):
            rest[touched[i]] = 0.0
        moves = rest.any()
        matrix, inner, shifted, filled = np.zeros((a, a)), np.empty((a, a)), np.empty(a), np.empty(a, np.int64)
        for j in range(a):
            row, packed = compliance[touched[j]], inner[j]
            shifted[j] = dot(row, rest) if moves else 0.0
            for c in range(a):
                packed[c] = row[touched[c]]
        for first in range(0, a, 3):  # the rows of a node, where its directions stand together: filled alike
            last = min(first + 3, a)
            count = 0
            for j in range(a):
                used = False
                for i in range(first, last):
                    used = used or stiffness[i, j] != 0.0
                if used:
                    filled[count] = j
                    count += 1
            for i in range(first, last):
                value = error[touched[i]]
                for k in range(count):
                    value -= stiffness[i, filled[k]] * shifted[filled[k]]
                rhs[i] = value
            if last == first + 3:
                _add_three_rows(stiffness, inner, filled[:count], first, matrix)
            else:
                for i in range(first, last):
                    row = matrix[i]
                    for k in range(count):
                        h0, w0 = stiffness[i, filled[k]], inner[filled[k]]
                        for c in range(a):
                            row[c] += h0 * w0[c]
            for i in range(first, last):
                matrix[i, i] += 1.0
        regular = solve_in_place(matrix, rhs)
        if regular:
            for i in range(a):
                change[touched[i]] = rhs[i]
    symmetric_times(compliance, change, move)
    return regular


@dataclass(frozen=True, eq=False)
class CondensedSolution:
    """Equilibrium of the condensed body.

    Attributes:
        force: gradient of contact by the unknowns, λ, shape (m,).
        increment: of the unknowns, y, shape (m,).
        converged: whether |λ − g(y)| met its tolerance.
        iterations: of Newton's method.
    """

    force: FloatArray
    increment: FloatArray
    converged: bool
    iterations: int


def solve_condensed(
    compliance: FloatArray, free: FloatArray, law: ContactLaw, *, start: FloatArray, largest_move: float,
    tolerance: float = 1e-10, floor: float = 1e-6, max_iterations: int = 100,
) -> CondensedSolution:
    """Solve y = y₀ − W g(y).

    Args:
        compliance: W, shape (m, m), symmetric.
        free: y₀, shape (m,).
        law: the contact forces.
        start: first guess of the forces λ, shape (m,).
        largest_move: of any unknown in one iteration; keeps contact points on their side of the skin.
        tolerance: of |λ − g| relative to |g|.
        floor: forces below this count as this in the tolerance [N].
        max_iterations: of Newton's method.
    """
    force = start.copy()
    y = free - _times(compliance, force)
    found = law(y, True)
    least = np.inf
    for iteration in range(max_iterations):
        error = found[0] - force
        if np.linalg.norm(error) <= tolerance * max(float(np.linalg.norm(found[0])), floor):
            return CondensedSolution(found[0], y, True, iteration)
        size = float((error * _times(compliance, error)).sum())
        move, change, slope = _direction(compliance, error, found[1], found[2])
        length = min(1.0, largest_move / max(float(np.abs(move).max()), 1e-300))
        # Newton's direction always shrinks the error at first; where steps by slope have begun to run in a circle
        # between stick and slip, that is what a step is held to.
        trial = None
        if np.isfinite(slope):
            trial = _shrink(law, compliance, (y, force), (move, change), length, size, patient=size >= least)
        least = min(least, size)
        if trial is None:
            # Friction makes the stiffness unsymmetric and curvature makes it indefinite: without both of them, the
            # direction is one of descent for sure.
            if not slope < 0.0:
                found = law(y, False)
                move, change, slope = _direction(compliance, error, found[1], found[2])
                length = min(1.0, largest_move / max(float(np.abs(move).max()), 1e-300))
            if not slope < 0.0:
                break
            trial = _line_search(law, y, force, move, change, slope, length)
        length, found = trial
        y = y + length * move
        force = force + length * change
    return CondensedSolution(force, y, False, max_iterations)


def _times(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    """Product without BLAS, whose threads cost more than they save on so little."""
    product: FloatArray = np.einsum("ij,j->i", matrix, vector)
    return product


def _shrink(
    law: ContactLaw, compliance: FloatArray, at: tuple[FloatArray, FloatArray],
    direction: tuple[FloatArray, FloatArray], length: float, size: float, *, patient: bool,
) -> tuple[float, tuple[FloatArray, FloatArray, IntArray]] | None:
    """Length at which the error's square Fᵀ W F has shrunk: to a quarter at once, or a little after halvings."""
    for _ in range(12 if patient else 1):
        found = law(at[0] + length * direction[0], True)
        rest = found[0] - at[1] - length * direction[1]
        if (rest * _times(compliance, rest)).sum() <= (1.0 - 0.2 * length if patient else 0.25) * size:
            return length, found
        length *= 0.5
    return None


def _direction(
    compliance: FloatArray, error: FloatArray, stiffness: FloatArray, touched: IntArray,
) -> tuple[FloatArray, FloatArray, float]:
    """Newton's dy and dλ, and the slope dyᵀ (g − λ), NaN where there is no such step."""
    change, back = np.empty_like(error), np.empty_like(error)
    regular = newton_step(compliance, error, np.ascontiguousarray(stiffness), touched, change, back)
    move = -back
    return move, change, float(move @ error) if regular else np.nan


def _line_search(
    law: ContactLaw, y: FloatArray, force: FloatArray, move: FloatArray, change: FloatArray, slope: float,
    length: float,
) -> tuple[float, tuple[FloatArray, FloatArray, IntArray]]:
    """Length and law where |slope| has fallen enough: the full length if possible, else by bracketed secants."""
    low, slope_low, high, slope_high = 0.0, slope, np.inf, np.nan
    best, best_slope, best_found = 0.0, np.inf, None
    for _ in range(12):
        found = law(y + length * move, True)
        here = float(move @ (found[0] - force - length * change))
        if np.isfinite(here) and abs(here) < best_slope:
            best, best_slope, best_found = length, abs(here), found
        if here <= 0.0 and np.isinf(high):
            return length, found  # still downhill at the largest length allowed
        if abs(here) <= 0.5 * abs(slope):
            return length, found
        if here < 0.0:
            low, slope_low = length, here
        else:
            high, slope_high = length, here
        fraction = slope_low / (slope_low - slope_high) if np.isfinite(slope_high) else 0.25
        length = low + min(max(fraction, 0.1), 0.9) * (high - low)
    assert best_found is not None
    return best, best_found
