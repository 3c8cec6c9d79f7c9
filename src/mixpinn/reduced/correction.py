"""What is added to the prior: nothing, a multiple of the Newton step, or a regression; cross-validation decides.

A fold of the cross-validation is a fit of its own: its modes and coordinates come from its own samples (and from fields
without simulation, where there are such).
With those of all samples, the positions left out would lie along directions that the fit was made for, and the test
would not show what happens along all others.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from mixpinn.base.arrays import AnyArray, BoolArray, Float32Array, FloatArray, IntArray
from mixpinn.reduced.hybrid import features
from mixpinn.reduced.ridge import column_deviations, column_norms, ridge


class Correction(StrEnum):
    """What is added to the prior; each kind contains the one before."""

    NONE = "none"
    """Nothing: the prior alone."""
    NEWTON = "Newton step"
    """A multiple ℓ of the Newton step, the best one by least squares."""
    STEP_REGRESSION = "regression on the Newton step"
    """That and a ridge regression, on the coefficients of the Newton step, of what it still misses."""
    REGRESSION = "regression"
    """A ridge regression on the prior's response besides."""


REACH = 2.0
"""How much more than on training samples the regression may add to the Newton step; chosen by hand."""
_USUAL = 0.95
"""Share of the training samples whose learned share counts; the rest hardly has a Newton step to compare with."""


def learned_share(step: AnyArray, correction: AnyArray, length: float) -> float:
    """|z − ℓ ν| / |ν| of nearly all samples, for Newton steps ν (S, m), corrections z (S, m) and ℓ = `length`."""
    size = np.maximum(np.linalg.norm(step, axis=1), 1e-12)
    share = np.linalg.norm(correction - length * step, axis=1) / size
    return float(np.quantile(share, _USUAL)) if len(share) else 0.0


WIDER = 4
"""So many times the coordinates are kept of the responses for cross-validation, whose coordinates are others."""


@dataclass(frozen=True, eq=False)
class _Fit:
    """Samples in the terms of a fit: features (S, F), of which the first m are ν, and targets (S, m)."""

    features: FloatArray
    target: FloatArray
    coordinates: int

    def select(self, chosen: AnyArray) -> "_Fit":
        return _Fit(self.features[chosen], self.target[chosen], self.coordinates)

    @property
    def modes(self) -> int:
        return self.target.shape[1]

    @property
    def step(self) -> FloatArray:
        return self.features[:, : self.modes]

    def scale(self, even: float) -> FloatArray:
        """Size of each feature, shape (F,): own¹⁻ᵉ largest of its kindᵉ, of deviations over samples, e = `even`.

        ν and a are coefficients in orthonormal modes: with one size for all of a kind, what training hardly excites is
        not blown up where it is excited. A feature that is nearly the same in all samples has no deviation; it counts
        with a thousandth of its size, since there is no constant term.
        """
        own = np.maximum(
            column_deviations(self.features), 1e-3 * column_norms(self.features) / np.sqrt(len(self.features)),
        )
        end = self.modes + self.coordinates
        of_step, of_response = (float(part.max(initial=1e-12)) for part in (own[: self.modes], own[self.modes: end]))
        largest = np.repeat([of_step, of_response, of_response**2], [self.modes, self.coordinates, len(own) - end])
        scale: FloatArray = own ** (1.0 - even) * largest**even
        return scale


@dataclass(frozen=True, eq=False)
class _Fold:
    """Positions left out, as a fit on the other ones sees them: modes and coordinates are the other ones' own.

    Attributes:
        train, test: samples.
        modes: of the fold in those of all samples, shape (r, m).
        truth: coefficients of the left out samples in the modes of all, shape (S', m).
        out: which samples are left out, shape (S,).
    """

    train: _Fit
    test: _Fit
    modes: FloatArray
    truth: FloatArray
    out: BoolArray

    @staticmethod
    def of(whole: _Fit, responses: FloatArray, drawn: AnyArray, out: BoolArray) -> "_Fold":
        modes = _directions(np.concatenate([whole.target[~out], drawn]), least=1e-6)
        own = _directions(responses[~out], least=1e-3)[: whole.coordinates]
        rows = features(whole.step @ modes.T, responses @ own.T).astype(np.float64)
        samples = _Fit(rows, whole.target @ modes.T, len(own))
        return _Fold(samples.select(~out), samples.select(out), modes, whole.target[out], out)

    def errors(self, choice: "_Choice") -> FloatArray:
        """Norm of the error of each sample that was left out, cut back to the reach of the fit, shape (S',)."""
        gain, length = choice.fit(self.train)
        most = REACH * learned_share(self.train.step, self.train.features @ gain, length)
        physical = length * self.test.step
        learned = self.test.features @ gain - physical
        size = np.maximum(np.linalg.norm(learned, axis=1), 1e-30)
        cut = np.minimum(1.0, most * np.linalg.norm(self.test.step, axis=1) / size)
        errors: FloatArray = np.linalg.norm(self.truth - (physical + learned * cut[:, None]) @ self.modes, axis=1)
        return errors


def _directions(rows: FloatArray, *, least: float) -> FloatArray:
    """Principal directions of rows (S, K), those of at least `least` of the largest one's size, shape (r, K)."""
    _, size, found = np.linalg.svd(rows, full_matrices=False)
    directions: FloatArray = found[size > least * size.max(initial=0.0)]
    return directions


@dataclass(frozen=True)
class _Choice:
    """A way to make the correction.

    Attributes:
        kind: none, a multiple of the Newton step, or a regression besides.
        newton: use the Newton step.
        response: use the coordinates and their products.
        even: how far all features of a kind count with one size (`_Fit.scale`).
        penalty: of the regression.
    """

    kind: Correction
    newton: bool = False
    response: bool = False
    even: float = 0.0
    penalty: float = 0.0

    def used(self, samples: _Fit) -> BoolArray:
        """Which features, shape (F,)."""
        of_step = np.arange(samples.features.shape[1]) < samples.modes
        return (of_step & self.newton) | (~of_step & self.response)

    def fit(self, samples: _Fit) -> tuple[FloatArray, float]:
        """Gain (F, m) and ℓ."""
        gain, length = np.zeros((samples.features.shape[1], samples.modes)), 0.0
        if self.newton:
            length = max(0.0, float((samples.step * samples.target).sum() / max((samples.step**2).sum(), 1e-30)))
            gain[: samples.modes] = length * np.eye(samples.modes)
        if self.penalty > 0.0:
            used = self.used(samples)
            gain[used] += ridge(
                samples.features[:, used], samples.target - length * samples.step,
                penalty=self.penalty * len(samples.target), scale=samples.scale(self.even)[used],
            )
        return gain, length


def _choices(newton: bool, response: bool, penalties: Sequence[float]) -> list[list[_Choice]]:
    """From the simplest on; of each kind the ways to choose from."""
    ways = [(even, penalty) for penalty in penalties for even in (0.0, 0.5, 1.0)]
    kinds = []
    if newton:
        kinds.append([_Choice(Correction.NEWTON, newton=True)])
        kinds.append([_Choice(Correction.STEP_REGRESSION, True, False, *way) for way in ways])
    if response:
        kinds.append([_Choice(Correction.REGRESSION, newton, True, *way) for way in ways])
    return kinds


def choose_correction(
    step: Float32Array, coordinates: Float32Array, target: Float32Array, position: IntArray, *,
    responses: AnyArray, drawn: AnyArray, newton: bool, response: bool, penalties: Sequence[float], folds: int = 5,
) -> tuple[Float32Array, dict[str, Any]]:
    """Gain on the features, shape (F, m), and what cross-validation over positions chose.

    A regression shrinks towards a multiple of the Newton step, not towards zero. Each kind of `Correction` is taken
    only where it predicts positions that it was not fitted on better than the simpler ones: a regression by more than
    the standard error of the difference over positions, so that with few samples physics remains.

    Args:
        step: ν, shape (S, m).
        coordinates: a, shape (S, k).
        target: coefficients of what the prior misses, shape (S, m).
        position: index of the probe position of each sample, shape (S,).
        responses: coefficients of the prior's responses in `WIDER` times as many modes as coordinates, shape (S, K).
        drawn: coefficients of fields that the modes come from besides the samples, shape (N, m).
        newton: use the Newton step.
        response: use the coordinates and their products.
        penalties: of the regression, to choose from.
        folds: parts of the positions that are left out in turn.
    """
    whole = _Fit(features(step, coordinates).astype(np.float64), target.astype(np.float64), coordinates.shape[1])
    best = _Choice(Correction.NONE)
    least: FloatArray = np.linalg.norm(whole.target, axis=1)
    report = {best.kind.value: float(least.mean())}
    places, part = np.unique(position, return_inverse=True)
    if len(places) > 1:
        left = [
            _Fold.of(whole, responses.astype(np.float64), drawn, part % folds == k)
            for k in range(min(folds, len(places)))
        ]
        for tried in _choices(newton, response, penalties):
            found = [(_cross_validate(choice, left, len(part)), choice) for choice in tried]
            errors, choice = min(found, key=lambda each: float(each[0].mean()))
            report[choice.kind.value] = float(errors.mean())
            if smaller(errors, least, part, margin=choice.penalty > 0.0):
                best, least = choice, errors
    gain, length = best.fit(whole)
    return gain.astype(np.float32), {
        "correction": best.kind.value, "ridge": best.penalty, "even": best.even,
        "features": int(best.used(whole).sum()), "newton_length": length, "cross_validation": float(least.mean()),
        "cross_validated": report,
    }


def _cross_validate(choice: _Choice, left: Sequence[_Fold], count: int) -> FloatArray:
    """Error of each of `count` samples by a fit on other positions, shape (S,)."""
    errors = np.empty(count)
    for fold in left:
        errors[fold.out] = fold.errors(choice)
    return errors


def smaller(errors: FloatArray, than: FloatArray, part: IntArray, *, margin: bool) -> bool:
    """Whether errors (S,) are smaller `than` others on average over the positions `part` (S,), 0, 1, ….

    Samples of one position err together. With a `margin`, by more than the standard error: by what chance may do with
    so few positions.
    """
    gained = np.bincount(part, than - errors) / np.bincount(part)
    return float(gained.mean()) > margin * float(gained.std(ddof=1)) / np.sqrt(len(gained))
