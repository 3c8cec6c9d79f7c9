"""BFGS updates of a factorized tangent, together with the block of the inverse that contact sees."""

from collections.abc import Callable

import numpy as np

from mixpinn.base.arrays import FloatArray, IntArray


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
        self._pairs: list[tuple[FloatArray, FloatArray, float]] = []

    def __len__(self) -> int:
        return len(self._pairs)

    def apply(self, vector: FloatArray) -> FloatArray:
        """H times a vector, shape (n,)."""
        vector = vector.copy()
        weights = []
        for step, change, rho in reversed(self._pairs):
            weight = rho * float(step @ vector)
            vector -= weight * change
            weights.append(weight)
        vector = self._solve(vector)
        for (step, change, rho), weight in zip(self._pairs, reversed(weights), strict=True):
            vector += step * (weight - rho * float(change @ vector))
        return vector

    def update(self, step: FloatArray, change: FloatArray, model_change: FloatArray) -> None:
        """Learn that the elastic residual changed by `change` over `step`, where H predicted `model_change`.

        A pair that shows less than a hundredth of the curvature expected is left out, so that H stays positive.
        """
        curvature = float(step @ change)
        if not curvature > 0.01 * abs(float(step @ model_change)):
            return
        rho = 1.0 / curvature
        inverse_change = self.apply(change)
        if len(self.kept):
            s, u = step[self.kept], inverse_change[self.kept]
            cross = np.outer(s, u)
            scale = rho * (1.0 + rho * float(change @ inverse_change))
            self.compliance = self.compliance - rho * (cross + cross.T) + scale * np.outer(s, s)
        self._pairs.append((step, change, rho))
