"""BFGS updates of a factorized tangent, together with the block of the inverse that contact sees."""

from collections.abc import Callable
from dataclasses import dataclass

import numba
import numpy as np

from mixpinn.base.arrays import FloatArray, IntArray

# Compiled loops rather than BLAS: on vectors this short a second thread is waited for longer than it helps, and very
# long where the cores are shared with other processes.


@numba.njit(cache=True)
def _backwards(steps, changes, rhos, count, vector, weights):  # type: ignore[no-untyped-def]
    for i in range(count - 1, -1, -1):
        total = 0.0
        for k in range(len(vector)):
            total += steps[i, k] * vector[k]
        weights[i] = rhos[i] * total
        for k in range(len(vector)):
            vector[k] -= weights[i] * changes[i, k]


@numba.njit(cache=True)
def _forwards(steps, changes, rhos, count, vector, weights):  # type: ignore[no-untyped-def]
    for i in range(count):
        total = 0.0
        for k in range(len(vector)):
            total += changes[i, k] * vector[k]
        total = weights[i] - rhos[i] * total
        for k in range(len(vector)):
            vector[k] += total * steps[i, k]


@dataclass(frozen=True, eq=False)
class _Pair:
    """A step and the elastic residuals before and after it, shape (n,) each."""

    step: FloatArray
    old: FloatArray
    new: FloatArray


class UpdatedInverse:
    """An approximate inverse H of the elastic tangent: a factorization and BFGS pairs.

    The secant condition H y = s, with y the change of the elastic residual over the step s, leaves contact aside, so
    that pairs stay valid whatever touches (H. Matthies and G. Strang, The solution of nonlinear finite element
    equations, International Journal for Numerical Methods in Engineering 14, 1979; two-loop form of J. Nocedal,
    Mathematics of Computation 35, 1980).

    A solve with the factorization is what an iteration costs. An iteration needs H times the residual g, and the pair
    of the last step needs H y with y = g − g₀; since H g₀ is known from the last iteration, H y = H g − H g₀ asks for
    no solve of its own, and the pair is therefore taken in when the next residual comes (`residual_step`).

    Attributes:
        kept: unknowns that contact can touch, shape (m,).
    """

    def __init__(self, solve: Callable[[FloatArray], FloatArray], compliance: FloatArray, kept: IntArray) -> None:
        self._solve = solve
        self._compliance, self.kept = compliance, kept
        self._count = 0
        self._steps: FloatArray = np.empty((0, 0))
        self._changes: FloatArray = np.empty((0, 0))
        self._rhos: FloatArray = np.empty(0)
        self._pending: _Pair | None = None
        self._seen: tuple[FloatArray, FloatArray] | None = None

    def __len__(self) -> int:
        return self._count + (self._pending is not None)

    @property
    def compliance(self) -> FloatArray:
        """The block of H for the unknowns `kept`, shape (m, m)."""
        self._settle()
        return self._compliance

    def residual_step(self, residual: FloatArray) -> FloatArray:
        """H times the residual of a configuration, shape (n,), which is remembered for the pair of the next step."""
        pair, seen = self._pending, self._seen
        if pair is not None and seen is not None and pair.new is residual and pair.old is seen[0]:
            self._pending = None
            moved = self._two_loops(residual)
            change, turned = residual - pair.old, moved - seen[1]
            rho = self._insert(pair.step, change, turned)
            # (1 − ρ s yᵀ) H (1 − ρ y sᵀ) g + ρ s sᵀ g from H g and H y
            along = rho * float((pair.step * residual).sum())
            moved = moved - along * turned
            moved += (along - rho * float((change * moved).sum())) * pair.step
        else:
            moved = self.apply(residual)
        self._seen = (residual, moved)
        return moved

    def learn(self, step: FloatArray, old: FloatArray, new: FloatArray, model_change: FloatArray) -> None:
        """Learn that the elastic residual went from `old` to `new` over `step`; see `update`."""
        self._settle()
        curvature = float((step * (new - old)).sum())
        if curvature > 0.01 * abs(float((step * model_change).sum())):
            self._pending = _Pair(step, old, new)

    def _settle(self) -> None:
        """Take in the pair that waits, by a solve of its own."""
        pair, self._pending = self._pending, None
        if pair is not None:
            change = pair.new - pair.old
            self._insert(pair.step, change, self._two_loops(change))
            self._seen = None

    def apply(self, vector: FloatArray) -> FloatArray:
        """H times a vector, shape (n,)."""
        self._settle()
        return self._two_loops(vector)

    def _two_loops(self, vector: FloatArray) -> FloatArray:
        if not self._count:
            return self._solve(vector)
        vector, weights = vector.copy(), np.empty(self._count)
        _backwards(self._steps, self._changes, self._rhos, self._count, vector, weights)
        vector = self._solve(vector)
        _forwards(self._steps, self._changes, self._rhos, self._count, vector, weights)
        return vector

    def update(self, step: FloatArray, change: FloatArray, model_change: FloatArray) -> None:
        """Learn that the elastic residual changed by `change` over `step`, where H predicted `model_change`.

        A pair that shows less than a hundredth of the curvature expected is left out, so that H stays positive.
        """
        curvature = float((step * change).sum())
        if not curvature > 0.01 * abs(float((step * model_change).sum())):
            return
        self._insert(step, change, self.apply(change))
        self._seen = None

    def _insert(self, step: FloatArray, change: FloatArray, inverse_change: FloatArray) -> float:
        """Append a pair s, y with H y; returns ρ = 1 / sᵀ y."""
        rho = 1.0 / float((step * change).sum())
        if len(self.kept):
            s, u = step[self.kept], inverse_change[self.kept]
            cross = np.outer(s, u)
            scale = rho * (1.0 + rho * float((change * inverse_change).sum()))
            self._compliance = self._compliance - rho * (cross + cross.T) + scale * np.outer(s, s)
        if self._count == len(self._rhos):
            room = max(8, self._count)
            self._steps = np.concatenate([self._steps.reshape(self._count, len(step)), np.empty((room, len(step)))])
            self._changes = np.concatenate([self._changes.reshape(self._count, len(step)), np.empty((room, len(step)))])
            self._rhos = np.concatenate([self._rhos, np.empty(room)])
        self._steps[self._count], self._changes[self._count], self._rhos[self._count] = step, change, rho
        self._count += 1
        return rho
