"""PoseErrorLaw: which errors to expect of an answer from the pose, from what can be seen of the answer itself.

Each error e (mean Euclidean error of the field, force on the probe, largest translation of a rigid part) has a scale
ê that follows a log-linear law, log ê = c₀ + Σ c_i log s_i, of the signs s: how large field, force and motion are, how
far the body departed from its linear answer, and how much was learned on top. The law is fitted on predictions of poses
that the correction was not fitted on, as if errors were normal with standard deviation ê: most likely is the least

    Σ (log ê + e² / 2 ê²),

which is convex in c. (A regression of log e would follow errors that happen to be small, of which bounds tell nothing.)
The bound is ê times the quantile of e / ê on these poses.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from mixpinn.base.arrays import AnyArray, FloatArray

TARGETS = ("field", "force", "motion")
"""What errors are told of: field [mm], force [N], motion of the rigid parts [mm]."""
_FLOOR = 1e-6
_STEPS = 60
"""Of Newton's method; about ten are needed."""


@dataclass(frozen=True, eq=False)
class PoseErrorLaw:
    """A calibrated law of the errors `TARGETS`.

    Attributes:
        coefficients: c₀ and c_i of each error, shape (3, 1 + s).
        factor: of ê in the bound of each, shape (3,).
        level: probability of the bounds.
    """

    coefficients: FloatArray
    factor: FloatArray
    level: float

    def expected(self, signs: AnyArray) -> FloatArray:
        """ê of each error for signs, shape (3,); later ones than the law was fitted with do not count."""
        found: FloatArray = np.exp(self.coefficients @ _row(signs)[: self.coefficients.shape[1]])
        return found

    @staticmethod
    def fit(signs: FloatArray, errors: FloatArray, *, level: float = 0.95, penalty: float = 1e-3) -> "PoseErrorLaw":
        """Calibrate.

        Args:
            signs: of n answers, shape (n, s).
            errors: of them, shape (n, 3).
            level: probability of the bounds.
            penalty: of the squares of c_i, relative to the number of answers; keeps collinear signs apart.
        """
        rows = np.array([_row(sign) for sign in signs])
        size = np.maximum(errors, _FLOOR)
        coefficients = np.array([_scale_law(rows, size[:, j], penalty) for j in range(size.shape[1])])
        ratio = size * np.exp(-rows @ coefficients.T)
        return PoseErrorLaw(coefficients, np.quantile(ratio, level, axis=0), level)

    def as_dict(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "coefficients": self.coefficients.tolist(), "factor": self.factor.tolist(), "level": self.level,
        }

    @staticmethod
    def of_dict(values: Mapping[str, Any]) -> "PoseErrorLaw":
        """From what `as_dict` gave."""
        return PoseErrorLaw(
            np.array(values["coefficients"], dtype=np.float64), np.array(values["factor"], dtype=np.float64),
            float(values["level"]),
        )


def _row(signs: AnyArray) -> FloatArray:
    return np.concatenate([[1.0], np.log(np.maximum(signs, _FLOOR))])


def _scale_law(rows: FloatArray, errors: FloatArray, penalty: float) -> FloatArray:
    """c of least Σ (log ê + e² / 2 ê²) + ½ `penalty` n Σ c_i², c₀ free, of rows [1, log s] (n, 1 + s), errors (n,)."""
    centre = np.concatenate([[0.0], rows[:, 1:].mean(axis=0)])
    centred = rows - centre
    squared, held = errors**2, penalty * len(rows) * np.eye(rows.shape[1])
    held[0, 0] = 0.0

    def cost(c: FloatArray) -> float:
        scale = centred @ c
        return float((scale + 0.5 * squared * np.exp(-2.0 * scale)).sum() + 0.5 * c @ held @ c)

    c = np.zeros(rows.shape[1])
    c[0] = 0.5 * np.log(squared.mean())
    for _ in range(_STEPS):
        share = squared * np.exp(-2.0 * (centred @ c))
        slope = centred.T @ (1.0 - share) + held @ c
        curvature = centred.T @ (centred * (2.0 * share)[:, None]) + held
        curvature[0, 0] += 1e-9 * len(rows)
        step, length, before = -np.linalg.solve(curvature, slope), 1.0, cost(c)
        while length > 1e-6 and not cost(c + length * step) <= before:
            length *= 0.5
        c = c + length * step
        if np.abs(length * step).max() < 1e-9:
            break
    c[0] -= c[1:] @ centre[1:]
    return c
