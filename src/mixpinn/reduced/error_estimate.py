"""ErrorEstimate: which error to expect of a prediction, from what its own equilibrium says.

A predicted state that is not in equilibrium shows it: the Newton step that remains at it is the error's shadow in the
modes. Together with how far the correction went and how much of it was not the Newton step itself, it tells the mean
error by a log-linear law, log ê = c₀ + Σ c_i log s_i, fitted on samples that the correction was not fitted on. A bound
is ê times the quantile of e / ê on such samples.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from mixpinn.base.arrays import AnyArray, FloatArray
from mixpinn.base.errors import InputError
from mixpinn.base.validated import ArraySpec, checked_record
from mixpinn.reduced.ridge import ridge

_LOW = 8
"""Modes that count as large-scale; chosen by hand."""
_FLOOR = 1e-6
"""Smaller signs and errors count as this [mm]: far below the error of any model, so that a logarithm exists."""


@dataclass(frozen=True)
class Signs:
    """What an error shows in, for one prediction.

    Attributes:
        size: norms of the Newton step from the prior, of the correction, of their difference, and of the step that
            remains at the prediction in large-scale and in all other modes [mm times √n], shape (5,).
        coordinates: principal coordinates of the prior's response, shape (k,).
    """

    size: FloatArray
    coordinates: FloatArray

    @staticmethod
    def of(step: AnyArray, correction: AnyArray, remaining: AnyArray, coordinates: AnyArray) -> "Signs":
        """From coefficients in the modes, shapes (m,), and principal coordinates (k,)."""
        parts = (step, correction, correction - step, remaining[:_LOW], remaining[_LOW:])
        return Signs(
            np.array([np.linalg.norm(part) for part in parts], dtype=np.float64),
            np.asarray(coordinates, dtype=np.float64),
        )


@dataclass(frozen=True, eq=False)
class ErrorEstimate:
    """A calibrated estimate of the mean Euclidean error.

    Attributes:
        coefficients: c₀ and c_i, shape (6,).
        factor: quantile of e / ê that the bound uses.
        level: its probability.
        spread: inverse covariance of the training samples' coordinates, shape (k, k).
        farthest: how far from zero training samples reach in this metric; beyond it an input is outside of what the
            model has seen.
    """

    coefficients: FloatArray
    factor: float
    level: float
    spread: FloatArray
    farthest: float

    def expected(self, signs: Signs) -> float:
        """Expected mean Euclidean error [mm]."""
        return float(np.exp(self.coefficients @ _row(signs)))

    def bound(self, signs: Signs) -> float:
        """Bound that the mean Euclidean error [mm] keeps with probability `level`."""
        return self.factor * self.expected(signs)

    def outside(self, signs: Signs) -> bool:
        """Whether the input lies outside of what the model has seen in training."""
        return float(np.sqrt(signs.coordinates @ self.spread @ signs.coordinates)) > self.farthest

    @staticmethod
    def fit(
        signs: list[Signs], error: AnyArray, *, training_coordinates: AnyArray, level: float = 0.95,
        penalty: float = 1e-2,
    ) -> "ErrorEstimate":
        """Calibrate on samples that the model was not fitted on.

        Args:
            signs: of each sample, S of them.
            error: their mean Euclidean error [mm], shape (S,).
            training_coordinates: of the samples that the model was fitted on, shape (T, k).
            level: probability of the bound.
            penalty: of the regression, relative to the number of samples; keeps collinear signs apart. The
                default was chosen by hand.
        """
        rows = np.array([_row(sign) for sign in signs])
        target = np.log(np.maximum(error, _FLOOR))
        centre = rows.mean(axis=0)
        centred = rows[:, 1:] - centre[1:]
        slopes = ridge(centred, target - target.mean(), penalty=penalty * len(rows))
        coefficients = np.concatenate([[target.mean() - slopes @ centre[1:]], slopes])
        ratio = np.exp(target - rows @ coefficients)
        # The quantile of a finite sample, with the margin of conformal prediction.
        rank = min(1.0, np.ceil((len(ratio) + 1) * level) / len(ratio))
        trained = np.asarray(training_coordinates, dtype=np.float64)
        count, size = trained.shape
        covariance = trained.T @ trained / count
        # Few samples do not span their coordinates: shrink towards a sphere, and leave room for what they have missed.
        share = size / (count + size)
        shrunk = (1.0 - share) * covariance + (share * np.trace(covariance) / size + 1e-30) * np.eye(size)
        spread = np.linalg.inv(shrunk)
        distance = np.sqrt(np.einsum("ti,ij,tj->t", trained, spread, trained))
        farthest = float(distance.max()) * (1.0 + size / count)
        return ErrorEstimate(
            coefficients, float(np.quantile(ratio, rank)), level, spread, farthest,
        )

    def as_dict(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "coefficients": self.coefficients, "factor": self.factor, "level": self.level, "spread": self.spread,
            "farthest": self.farthest,
        }

    @staticmethod
    def of_dict(values: Mapping[str, Any], where: str, *, coordinates: int, remake: str) -> "ErrorEstimate":
        """From what `as_dict` gave.

        Args:
            values: plain values.
            where: they stand, for the message.
            coordinates: their number k.
            remake: what a user does where they are damaged.

        Raises:
            InputError: a value that is absent, not finite or of another shape.
        """
        plain = checked_record(_Plain, dict(values), where, remake=remake)
        try:
            coefficients, spread = (np.array(rows, dtype=np.float64) for rows in (plain.coefficients, plain.spread))
        except ValueError as error:
            raise InputError(f"{where}: spread", expected="rows of one length", got="others", fix=remake) from error
        for name, array, shape in (
            ("coefficients", coefficients, (6,)), ("spread", spread, (coordinates, coordinates)),
        ):
            ArraySpec("number", shape).check(array, f"{where}: {name}", extents={}, remake=remake)
        return ErrorEstimate(coefficients, plain.factor, plain.level, spread, plain.farthest)


@dataclass(frozen=True)
class _Plain:
    """What an estimate is in JSON."""

    coefficients: list[float]
    factor: float
    level: float
    spread: list[list[float]]
    farthest: float


def _row(signs: Signs) -> FloatArray:
    return np.concatenate([[1.0], np.log(np.maximum(signs.size, _FLOOR))])
