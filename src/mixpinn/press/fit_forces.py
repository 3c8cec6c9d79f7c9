"""Fit the law of the force of a probe (`mixpinn.press.force_law`) to simulations.

Positions are left out in turn: which signs the law has, how strong it is held back, and whether it is kept at all are
what serves best where it was not fitted. What is learned on top of it, and the errors to expect, are learned from
predictions with laws that were not fitted at their position.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mixpinn.base.arrays import BoolArray, FloatArray, IntArray
from mixpinn.geometry.probe_pose import PROBE_AXIS
from mixpinn.press.domain import across_axes
from mixpinn.press.fit import FOLDS, PoseSamples
from mixpinn.press.force_law import TERMS, ForceLaw, across_terms
from mixpinn.press.grip import SIGNS, Grip
from mixpinn.press.model import PoseModel
from mixpinn.reduced.correction import smaller
from mixpinn.reduced.ridge import ridge

_PENALTIES = (1e-4, 1e-3, 1e-2, 1e-1)
"""Relative to signs of mean square 1 and to the number of samples."""
_BASIC = ((0,), (0, 1, 2, 8), (0, 1, 2, 5, 7, 8, 9), tuple(range(SIGNS - 1)))
_ALONG = (*_BASIC, *((*signs, SIGNS - 1) for signs in _BASIC))
"""Signs of the force along that are tried; which to try was found on simulations of two patients."""
_SMALL = 1.0
"""Forces count by their relative error, where they are larger than this, and less where they are smaller [N]."""
_ACROSS = ((1, 2, 4, 5), tuple(range(TERMS)))
"""Terms of the force across that are tried, beside that of the contact as it is."""
_AS_IT_IS = np.tile(np.eye(1, TERMS), (2, 1))
"""Coefficients with which the force across stays that of the contact."""
_MORE = 1.5
"""A force may be changed by so many times the largest logarithm that samples ask for."""


@dataclass(frozen=True, eq=False)
class _Rows:
    """What laws are fitted on; N samples of one probe.

    Attributes:
        signs: of the force along, shape (N, SIGNS).
        weight: of each sample, shape (N,).
        asked: logarithm of the factor of the force on finer skin, shape (N,).
        terms: of the force across, with the factor asked for of that of the contact, shape (N, 2, TERMS).
        sideways: true force across along both axes [N], shape (N, 2).
        axes: of the body, shape (2, 3).
    """

    signs: FloatArray
    weight: FloatArray
    asked: FloatArray
    terms: FloatArray
    sideways: FloatArray
    axes: FloatArray

    @staticmethod
    def of(grips: Sequence[Grip], true: FloatArray, axes: FloatArray) -> "_Rows":
        """From grips of one probe and the true forces on the skin (N, 3) [N]."""
        along = np.concatenate([grip.along for grip in grips])
        push = np.concatenate([grip.push for grip in grips])
        wanted = np.maximum(np.einsum("ni,ni->n", true, along), 1e-3)
        asked = np.log(wanted / np.concatenate([grip.firm for grip in grips]))
        terms = np.concatenate([across_terms(grip, axes) for grip in grips]) * (wanted / push)[:, None, None]
        sideways = (true - wanted[:, None] * along) @ axes.T
        signs = np.concatenate([grip.signs for grip in grips])
        return _Rows(signs, push / (push + _SMALL), asked, terms, sideways, axes)

    def along(self, known: BoolArray, chosen: tuple[int, ...], penalty: float) -> FloatArray:
        """c fitted on `known` samples with the chosen signs, shape (SIGNS,)."""
        found, weight = np.zeros(SIGNS), self.weight[known]
        found[list(chosen)] = _fitted(
            self.signs[known][:, chosen] * weight[:, None], self.asked[known] * weight, penalty,
        )
        return found

    def across(self, known: BoolArray, chosen: tuple[int, ...], penalty: float) -> FloatArray:
        """Coefficients of the force across fitted on `known` samples with the chosen terms, shape (2, TERMS)."""
        found = np.zeros((2, TERMS))
        for axis in range(2):
            found[axis, list(chosen)] = _fitted(
                self.terms[known, axis][:, chosen], self.sideways[known, axis], penalty,
            )
        return found


def with_force_law(model: PoseModel, samples: PoseSamples, *, folds: int = FOLDS) -> tuple[PoseModel, PoseSamples]:
    """`model` with a law of forces and its samples, predicted by laws that were not fitted at their positions.

    The body follows the law where that helps fields or forces for sure and fields are not farther off; where they are,
    the law may still tell the force alone. Both as they are where positions are fewer than four, or no law helps.

    Args:
        model: without a law.
        samples: predictions of it, of one probe.
        folds: parts of the positions that are left out in turn.
    """
    positions = np.unique(samples.group)
    if len(positions) < 4:
        return model, samples
    found = [
        model.grip(base.contact, turn[None], place[None])
        for base, turn, place in zip(samples.base, samples.rotations, samples.translations, strict=True)
    ]
    kept = np.array([i for i, grip in enumerate(found) if grip is not None], dtype=np.int64)
    grips = [grip for grip in found if grip is not None]
    if len(kept) < len(found):
        samples = samples.select(kept)
    direction = (samples.rotations @ PROBE_AXIS).mean(axis=0)
    rows = _Rows.of(grips, -samples.true_wrench[:, :3], across_axes(direction / np.linalg.norm(direction)))
    part = np.searchsorted(np.unique(samples.group), samples.group)
    fold = part % min(folds, len(positions))
    chosen = _chosen(rows, fold)
    whole = _law(rows, np.ones(len(fold), dtype=bool), *chosen)
    laws = {int(one): _law(rows, fold != one, *chosen) for one in np.unique(fold)}
    for moves in (True, False):
        base = [
            model.with_law(before, replace(laws[int(one)], moves=moves), grip, tip[None])
            for before, one, grip, tip in zip(samples.base, fold, grips, samples.translations, strict=True)
        ]
        learned = replace(samples, base=base)
        if _helps(model, learned, samples, part):
            return replace(model, law=replace(whole, moves=moves)), learned
    return model, samples


def _helps(model: PoseModel, learned: PoseSamples, plain: PoseSamples, part: IntArray) -> bool:
    """Whether fields or forces come nearer for sure, and fields are not farther off.

    Forces that are right are worth having: what fields then still miss is the same everywhere, and is learned next.
    """
    weights = model.hybrid.prior.coordinates.weights
    fields = [np.linalg.norm(weights * each.missed, axis=1) for each in (learned, plain)]
    forces = [np.linalg.norm(each.missed_wrench[:, :3], axis=1) for each in (learned, plain)]
    surely = any(smaller(after, before, part, margin=True) for after, before in (fields, forces))
    return surely and not smaller(fields[1], fields[0], part, margin=False)


_Choice = tuple[tuple[int, ...], float]


def _law(rows: _Rows, known: BoolArray, along: _Choice, across: _Choice | None) -> ForceLaw:
    """The law fitted on `known` samples; None: the force across stays that of the contact."""
    return ForceLaw(
        rows.along(known, *along), _MORE * np.abs(rows.asked[known]).max(keepdims=True), rows.axes,
        _AS_IT_IS if across is None else rows.across(known, *across),
    )


def _chosen(rows: _Rows, fold: IntArray) -> tuple[_Choice, _Choice | None]:
    """Signs, terms and penalties that serve best at positions left out."""
    outs = [fold == one for one in np.unique(fold)]

    def miss_along(choice: _Choice) -> float:
        left = [rows.weight[out] * (rows.signs[out] @ rows.along(~out, *choice) - rows.asked[out]) for out in outs]
        return float((np.concatenate(left) ** 2).mean())

    def miss_across(choice: _Choice | None) -> float:
        left = []
        for out in outs:
            law = _AS_IT_IS if choice is None else rows.across(~out, *choice)
            left.append(np.einsum("njt,jt->nj", rows.terms[out], law) - rows.sideways[out])
        return float(np.linalg.norm(np.concatenate(left), axis=1).mean())

    along = min(((signs, penalty) for signs in _ALONG for penalty in _PENALTIES), key=miss_along)
    choices = [None, *((terms, penalty) for terms in _ACROSS for penalty in _PENALTIES)]
    return along, min(choices, key=miss_across)


def _fitted(rows: FloatArray, wanted: FloatArray, penalty: float) -> FloatArray:
    scale = np.sqrt((rows**2).mean(axis=0)) + 1e-12
    return ridge(rows, wanted, penalty=penalty * len(rows), scale=scale)
