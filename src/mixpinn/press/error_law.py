"""PoseErrorLaw: which errors to expect of an answer from the pose, from what can be seen of the answer itself.

Each error e (mean Euclidean error of the field, force on the probe, largest translation of a rigid part) follows a
log-linear law, log ê = c₀ + Σ c_i log s_i, of the signs s: how large field and force are, how far the body departed
from its linear answer, and how much was learned on top. The law is fitted on predictions of poses that the correction
was not fitted on; the bound is ê times a quantile of e / ê on them, with a margin for how few poses there were.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from mixpinn.base.arrays import AnyArray, FloatArray
from mixpinn.reduced.ridge import ridge

TARGETS = ("field", "force", "motion")
"""What errors are told of: field [mm], force [N], motion of the rigid parts [mm]."""
_FLOOR = 1e-6
_HIGHEST_RANK = 0.975
_FEW = 0.3
"""Answers at one position err alike: from few positions a quantile is uncertain by about this over their root."""


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
        """ê of each error for signs (s,), shape (3,)."""
        found: FloatArray = np.exp(self.coefficients @ _row(signs))
        return found

    @staticmethod
    def fit(signs: FloatArray, errors: FloatArray, groups: AnyArray, *, level: float = 0.95, penalty: float = 1e-3) -> (
        "PoseErrorLaw"
    ):
        """Calibrate.

        Args:
            signs: of n answers, shape (n, s).
            errors: of them, shape (n, 3).
            groups: which answers belong to one pose or place and are correlated, shape (n,).
            level: probability of the bounds.
            penalty: of the ridge regression, relative to the number of answers; keeps collinear signs apart.
        """
        rows = np.array([_row(sign) for sign in signs])
        target = np.log(np.maximum(errors, _FLOOR))
        centre = rows.mean(axis=0)
        centred = rows[:, 1:] - centre[1:]
        slopes = ridge(centred, target - target.mean(axis=0), penalty=penalty * len(rows)).T
        coefficients = np.column_stack([target.mean(axis=0) - slopes @ centre[1:], slopes])
        ratio = np.exp(target - rows @ coefficients.T)
        count = len(np.unique(groups))
        rank = min(_HIGHEST_RANK, level * (count + 1) / count)
        wider = 1.0 + _FEW / np.sqrt(count)
        return PoseErrorLaw(coefficients, wider * np.quantile(ratio, rank, axis=0), level)

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
