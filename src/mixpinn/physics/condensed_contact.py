"""Contact of an elastic body condensed to the unknowns that contact can touch.

With the elastic residual linearised, r + K Δ, and the contact forces λ(y) on the unknowns c that contact can touch
(y = Δ_c, residual r + K Δ + Sᵀ λ = 0), everything else is eliminated exactly:

    y = y₀ − W λ,    W = S K⁻¹ Sᵀ,    y₀ = −S K⁻¹ r,    λ = g(y).

y₀ is where the body would go without contact, W its compliance. What is left is a small dense problem in which all
contacts switch on and off, stick and slip; it is solved by Newton's method on λ − g(y₀ − W λ) = 0,

    (1 + H W) dλ = g + …,    that is    dy = −(1 + W H)⁻¹ W (g − λ),    dλ = g + H dy − λ,

with H = ∂g/∂y non-zero only among the unknowns that are touched. The length of each step is chosen where the slope
dyᵀ (g − λ) of the potential, if there is one, has fallen: this needs no energy and so allows for friction.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, lu_factor, lu_solve

from mixpinn.base.arrays import FloatArray, IntArray

ContactLaw = Callable[[FloatArray, bool], tuple[FloatArray, FloatArray, IntArray]]
"""g(y, exact): forces (m,), stiffness among the touched unknowns (a, a), and these, (a,).

The stiffness is the derivative of the forces if `exact`, otherwise a symmetric positive semi-definite part of it.
"""


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
    """Newton's dy and dλ, and the slope dyᵀ (g − λ)."""
    residual = _times(compliance, error)
    move = -residual
    change = error.copy()
    if len(touched):
        matrix = np.eye(len(touched)) + compliance[np.ix_(touched, touched)] @ stiffness
        try:
            inner = lu_solve(lu_factor(matrix, check_finite=False), -residual[touched], check_finite=False)
        except (LinAlgError, ValueError):
            return move, change, np.nan
        push = stiffness @ inner
        move = move - _times(compliance[:, touched], push)
        change[touched] += push
    return move, change, float(move @ error)


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
