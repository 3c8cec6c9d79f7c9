"""Fit what simulations teach about contact from the pose: modes and ridge regressions of `PoseCorrection`."""

from dataclasses import dataclass, replace

import numpy as np

from mixpinn.base.arrays import AnyArray, Float32Array, FloatArray, IntArray
from mixpinn.base.errors import InputError
from mixpinn.base.progress import track
from mixpinn.press.model import PoseCorrection, PoseModel
from mixpinn.records import SampleTable
from mixpinn.reduced.modes import coefficients, principal_modes
from mixpinn.reduced.quadratic_features import quadratic_features
from mixpinn.reduced.ridge import column_norms, ridge

RIDGES = (1e-5, 1e-4, 1e-3, 1e-2)
"""Strengths that are tried, relative to features of norm 1; the grid was chosen by hand, the value by validation."""
SIZES = (8, 12, 16, 24)
"""Numbers of coordinates that are tried; the grid was chosen by hand, the value by validation."""


@dataclass(frozen=True, eq=False)
class PoseSamples:
    """Predictions without correction beside the truth; N samples.

    Attributes:
        coordinates: a, shape (N, k).
        unknowns: predicted, float32, shape (N, D).
        truth: unknowns of the simulated fields, float32, shape (N, D).
        wrench: predicted, shape (N, 6).
        true_wrench: simulated, shape (N, 6).
    """

    coordinates: Float32Array
    unknowns: Float32Array
    truth: Float32Array
    wrench: FloatArray
    true_wrench: FloatArray


def collect(model: PoseModel, table: SampleTable, chosen: IntArray | None = None) -> PoseSamples:
    """Predict the samples `chosen` (by default all) of `table` from the pose, with the first probe of `model`."""
    index = np.arange(len(table)) if chosen is None else chosen
    coordinates = model.hybrid.prior.coordinates
    found, unknowns, truth, wrench = [], [], [], []
    for i in track(list(index), "contact from the pose"):
        base = model.uncorrected(table.probe_rotation[i][None], table.probe_translation[i][None])
        found.append(base.coordinates)
        unknowns.append(base.unknowns)
        truth.append(coordinates.project(table.displacement[i]).astype(np.float32))
        wrench.append(base.contact.wrench[0])
    return PoseSamples(
        np.array(found), np.array(unknowns), np.array(truth), np.array(wrench), table.probe_wrench[index],
    )


def fit_pose(
    model: PoseModel, training: PoseSamples, validation: PoseSamples, *, n_modes: int = 32, seed: int = 0,
) -> PoseModel:
    """`model` with a correction; the number of coordinates and the ridge are those that serve `validation` best.

    Args:
        model: without correction.
        training: of positions to learn from.
        validation: of other positions.
        n_modes: of the correction; the default was chosen by hand.
        seed: of the modes.

    Raises:
        InputError: no samples.
    """
    if not len(training.wrench) or not len(validation.wrench):
        raise InputError(
            "pose correction", expected="samples to train and to validate on", got="none", fix="simulate more poses",
        )
    weights = model.hybrid.prior.coordinates.weights
    modes = principal_modes(
        training.truth - training.unknowns, weights, n_modes, rng=np.random.default_rng(seed),
    )
    missing = coefficients(modes, weights, training.truth - training.unknowns)
    left = coefficients(modes, weights, validation.truth - validation.unknowns)
    wrench, wrench_left = training.true_wrench - training.wrench, validation.true_wrench - validation.wrench
    best: list[tuple[float, PoseCorrection]] = []
    for size in SIZES:
        k = min(size, training.coordinates.shape[1])
        scale = (training.coordinates[:, :k].std(axis=0) + 1e-12).astype(np.float32)
        known = quadratic_features(training.coordinates[:, :k] / scale)
        asked = quadratic_features(validation.coordinates[:, :k] / scale)
        for strength in RIDGES:
            solved = ridge(
                known, np.concatenate([missing, wrench], axis=1), penalty=strength, scale=column_norms(known),
            )
            gain, wrench_gain = solved[:, : len(modes)], solved[:, len(modes):]
            correction = PoseCorrection(modes, gain.astype(np.float32), wrench_gain, scale)
            field_error = float(np.linalg.norm(asked @ gain - left, axis=1).mean())
            force_error = float(np.linalg.norm((asked @ wrench_gain - wrench_left)[:, :3], axis=1).mean())
            best.append((field_error, correction))
            best.append((force_error, correction))
    field = min(best[0::2], key=lambda found: found[0])[1]
    force = min(best[1::2], key=lambda found: found[0])[1]
    # One set of features serves both: coordinates of the larger choice, with zero rows where the other has none.
    return replace(model, correction=_joined(field, force))


def _joined(field: PoseCorrection, force: PoseCorrection) -> PoseCorrection:
    """The field's gain of one correction and the wrench's of another, on the features of the larger one."""
    larger = max(field, force, key=lambda found: len(found.scale))
    return PoseCorrection(
        field.modes, _widened(field.gain, len(field.scale), len(larger.scale)).astype(np.float32),
        _widened(force.wrench_gain, len(force.scale), len(larger.scale)), larger.scale,
    )


def _widened(gain: AnyArray, k: int, wide: int) -> FloatArray:
    """A gain on quadratic features of k coordinates as one on those of `wide` ≥ k, zero on the new ones."""
    first, second = np.triu_indices(wide)
    kept = np.concatenate([np.arange(wide) < k, (first < k) & (second < k)])
    widened = np.zeros((len(kept), gain.shape[1]))
    widened[kept] = gain
    return widened
