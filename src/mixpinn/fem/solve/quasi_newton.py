"""BFGS updates of a factorized tangent, together with the block of the inverse that contact sees."""

from collections.abc import Callable

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


class UpdatedInverse:
    """An approximate inverse H of the elastic tangent: a factorization and BFGS pairs.

    The secant condition H y = s, with y the change of the elastic residual over the step s, leaves contact aside, so
    that pairs stay valid whatever touches (H. Matthies and G. Strang, The solution of nonlinear finite element
    equations, International Journal for Numerical Methods in Engineering 14, 1979; two-loop form of J. Nocedal,
    Mathematics of Computation 35, 1980).

    Attributes:
        compliance: the block of H for the unknowns `kept`, shape (m, m).
        kept: unknowns that contact can touch, shape (m,).
    """

    def __init__(self, solve: Callable[[FloatArray], FloatArray], compliance: FloatArray, kept: IntArray) -> None:
        self._solve = solve
        self.compliance, self.kept = compliance, kept
        self._count = 0
        self._steps: FloatArray = np.empty((0, 0))
        self._changes: FloatArray = np.empty((0, 0))
        self._rhos: FloatArray = np.empty(0)

    def __len__(self) -> int:
        return self._count

    def apply(self, vector: FloatArray) -> FloatArray:
        """H times a vector, shape (n,)."""
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
        rho = 1.0 / curvature
        inverse_change = self.apply(change)
        if len(self.kept):
            s, u = step[self.kept], inverse_change[self.kept]
            cross = np.outer(s, u)
            scale = rho * (1.0 + rho * float((change * inverse_change).sum()))
            self.compliance = self.compliance - rho * (cross + cross.T) + scale * np.outer(s, s)
        if self._count == len(self._rhos):
            room = max(8, self._count)
            self._steps = np.concatenate([self._steps.reshape(self._count, len(step)), np.empty((room, len(step)))])
            self._changes = np.concatenate([self._changes.reshape(self._count, len(step)), np.empty((room, len(step)))])
            self._rhos = np.concatenate([self._rhos, np.empty(room)])
        self._steps[self._count], self._changes[self._count], self._rhos[self._count] = step, change, rho
        self._count += 1
