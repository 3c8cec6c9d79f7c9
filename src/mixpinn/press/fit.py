"""Fit what simulations teach about contact from the pose: the correction, the errors to expect, the poses learned from.

Positions are left out in turn: the size of the correction is the one that serves best where it was not fitted, none
where no size serves for sure. The errors to expect are those of predictions at positions left out, with the size that
serves best at all others: a choice flatters the residuals that it was made with.
"""

from dataclasses import dataclass, replace

import numpy as np

from mixpinn.base.arrays import AnyArray, Float32Array, FloatArray, IntArray
from mixpinn.base.errors import InputError
from mixpinn.base.progress import track
from mixpinn.press.domain import PoseDomain
from mixpinn.press.error_law import PoseErrorLaw
from mixpinn.press.model import PoseCorrection, PoseModel, Uncorrected
from mixpinn.records import SampleTable
from mixpinn.reduced.coordinates import ReducedCoordinates
from mixpinn.reduced.correction import smaller
from mixpinn.reduced.modes import coefficients, principal_modes
from mixpinn.reduced.quadratic_features import quadratic_features
from mixpinn.reduced.ridge import column_norms, ridge

RIDGES = (1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0, 10.0, 100.0)
"""Strengths that are tried, relative to features of norm 1; the grid was chosen by hand, the value by validation."""
SIZES = (2, 4, 8, 12, 16, 24)
"""Numbers of coordinates that are tried; the grid was chosen by hand, the value by validation."""
FIELD, FORCE = slice(None, -6), slice(-6, -3)
"""Targets of the regression: coefficients of the field's modes, then force and moment."""
FOLDS = 8
"""Parts of the positions that are left out in turn."""
_LARGEST = 2.0
"""A correction may grow to so many times the largest one, relative to the whole, that training samples ask for."""


@dataclass(frozen=True, eq=False)
class PoseSamples:
    """Predictions without correction beside the truth; N samples.

    Attributes:
        base: the predictions.
        truth: unknowns of the simulated fields, float32, shape (N, D).
        true_wrench: simulated, shape (N, 6).
        group: position of each sample, shape (N,).
        rotations, translations: of the probe, shapes (N, 3, 3) and (N, 3) [mm].
    """

    base: list[Uncorrected]
    truth: Float32Array
    true_wrench: FloatArray
    group: IntArray
    rotations: FloatArray
    translations: FloatArray

    def select(self, chosen: IntArray) -> "PoseSamples":
        """The chosen samples, in that order."""
        return PoseSamples(
            [self.base[i] for i in chosen], self.truth[chosen], self.true_wrench[chosen], self.group[chosen],
            self.rotations[chosen], self.translations[chosen],
        )

    @property
    def coordinates(self) -> Float32Array:
        """a of all forces, shape (N, k)."""
        return np.array([base.coordinates for base in self.base])

    @property
    def missed(self) -> Float32Array:
        """What the predicted unknowns miss, shape (N, D)."""
        found: Float32Array = self.truth - np.array([base.unknowns for base in self.base])
        return found

    @property
    def missed_wrench(self) -> FloatArray:
        """What the predicted wrenches miss, shape (N, 6)."""
        found: FloatArray = self.true_wrench - np.array([base.contact.wrench[0] for base in self.base])
        return found


def collect(model: PoseModel, table: SampleTable, chosen: IntArray | None = None) -> PoseSamples:
    """Predict the samples `chosen` (by default all) of `table` from the pose, with the first probe of `model`.

    Samples whose contact does not converge are left out.
    """
    index = np.arange(len(table)) if chosen is None else chosen
    coordinates = model.hybrid.prior.coordinates
    found, truth, kept = [], [], []
    for i in track(list(index), "contact from the pose"):
        base = model.uncorrected(table.probe_rotation[i][None], table.probe_translation[i][None])
        if base.contact.converged and len(base.contact.nodes):
            found.append(base)
            truth.append(coordinates.project(table.displacement[i]).astype(np.float32))
            kept.append(i)
    return PoseSamples(
        found, np.array(truth, dtype=np.float32).reshape(len(kept), coordinates.size), table.probe_wrench[kept],
        table.position_index[kept], table.probe_rotation[kept], table.probe_translation[kept],
    )


def fitted_bend(model: PoseModel, table: SampleTable, *, most: int = 48) -> PoseModel:
    """`model` with the part of the Newton step of contact, β, with which forces on the probe fit best.

    Forces change nearly in proportion to β, from f⁰ of the linear body to f¹ of the whole step: least squares of
    f⁰ + β (f¹ − f⁰) against simulated forces, relative to these, on at most `most` samples spread over the table.
    """
    chosen = np.unique(np.linspace(0.0, max(len(table) - 1, 0), min(most, len(table))).astype(np.int64))
    whole, linear = replace(model, bend=1.0), replace(model, steps=0)
    up, down = 0.0, 0.0
    for i in track(list(chosen), "contact of the bent body"):
        pose = table.probe_rotation[i][None], table.probe_translation[i][None]
        first, second = (each.uncorrected(*pose).contact for each in (linear, whole))
        true = table.probe_wrench[i, :3]
        if first.converged and second.converged and np.linalg.norm(true) > 0.0:
            way = (second.wrench[0, :3] - first.wrench[0, :3]) / np.linalg.norm(true)
            up += float(way @ (true - first.wrench[0, :3])) / float(np.linalg.norm(true))
            down += float(way @ way)
    return replace(model, bend=float(np.clip(up / down, 0.0, 1.0))) if down > 1e-12 else model


def fit_pose(
    model: PoseModel, samples: PoseSamples, *, n_modes: int = 32, folds: int = FOLDS, seed: int = 0,
) -> PoseModel:
    """`model` with a correction, the errors to expect of it, and the poses that it was learned from.

    Args:
        model: without correction.
        samples: to learn from.
        n_modes: of the correction; the default was chosen by hand.
        folds: parts of the positions that are left out in turn.
        seed: of the modes.

    Raises:
        InputError: samples at fewer than two positions.
    """
    positions = np.unique(samples.group)
    if len(positions) < 2:
        raise InputError(
            "pose correction", expected="samples at two positions or more", got=f"at {len(positions)}",
            fix="simulate more poses",
        )
    part = np.searchsorted(positions, samples.group)
    fold = part % min(folds, len(positions))
    weights = model.hybrid.prior.coordinates.weights
    modes = principal_modes(samples.missed, weights, n_modes, rng=np.random.default_rng(seed))
    targets = np.concatenate([coefficients(modes, weights, samples.missed), samples.missed_wrench], axis=1)
    candidates: list[tuple[FloatArray, FloatArray, PoseCorrection, FloatArray]] = []
    for size in SIZES:
        k = min(size, samples.coordinates.shape[1])
        scale = (samples.coordinates[:, :k].std(axis=0) + 1e-12).astype(np.float32)
        features = quadratic_features(samples.coordinates[:, :k] / scale)
        for strength in RIDGES:
            left = np.empty_like(targets)
            for one in np.unique(fold):
                out = fold == one
                known = features[~out]
                left[out] = features[out] @ ridge(known, targets[~out], penalty=strength, scale=column_norms(known))
            solved = ridge(features, targets, penalty=strength, scale=column_norms(features))
            rest = targets - left
            field_error, force_error = (np.linalg.norm(rest[:, of], axis=1) for of in (FIELD, FORCE))
            gain = solved[:, FIELD].astype(np.float32)
            found = PoseCorrection(modes, gain, solved[:, -6:], scale, np.full(2, np.inf))
            candidates.append((field_error, force_error, found, left))
    errors = np.array([[field_error, force_error] for field_error, force_error, _, _ in candidates])
    field, force = (candidates[int(of.mean(axis=1).argmin())][2] for of in errors.transpose(1, 0, 2))
    left = _blind(errors, [candidate[3] for candidate in candidates], fold)
    if not _helps(targets[:, FIELD], left[:, FIELD], part):
        left[:, :-6] = 0.0
        field.gain[:] = 0.0
    if not _helps(targets[:, FORCE], left[:, FORCE], part):
        left[:, -6:] = 0.0
        force.wrench_gain[:] = 0.0
    # One set of features serves both: coordinates of the larger choice, with zero rows where the other has none.
    correction = replace(_joined(field, force), largest=_largest(model, samples, targets))
    depths = np.array([base.contact.depths[0] for base in samples.base])
    domain = PoseDomain.of_samples(model.hybrid.mesh, samples.rotations, samples.translations, depths)
    return replace(model, correction=correction, domain=domain, error=_calibrate(model, samples, modes, left))


def _blind(errors: FloatArray, left: list[FloatArray], fold: IntArray) -> FloatArray:
    """Corrections of each fold by the candidate that serves best on all other folds, shape (N, t).

    Args:
        errors: of the field and of the force of each candidate at positions left out, shape (c, 2, N).
        left: corrections by each candidate at positions left out, c arrays (N, t), the last six columns the wrench.
        fold: of each sample, shape (N,).
    """
    found = np.empty_like(left[0])
    for one in np.unique(fold):
        out = fold == one
        field, force = errors[:, :, ~out].mean(axis=2).argmin(axis=0)
        found[out] = np.concatenate([left[field][out, :-6], left[force][out, -6:]], axis=1)
    return found


def _helps(targets: FloatArray, left: FloatArray, part: IntArray) -> bool:
    """Whether corrections `left` (N, t) of targets (N, t) help for sure at positions that were left out."""
    return smaller(np.linalg.norm(targets - left, axis=1), np.linalg.norm(targets, axis=1), part, margin=True)


def _largest(model: PoseModel, samples: PoseSamples, targets: FloatArray) -> FloatArray:
    """Largest corrections of field and force that the samples ask for, relative to these, with room to grow."""
    weights = model.hybrid.prior.coordinates.weights
    field = np.array([np.linalg.norm(weights * base.unknowns) for base in samples.base])
    force = np.array([np.linalg.norm(base.contact.wrench[0, :3]) for base in samples.base])
    asked = np.stack([
        np.linalg.norm(targets[:, :-6], axis=1) / np.maximum(field, 1e-6),
        np.linalg.norm(targets[:, -6:-3], axis=1) / np.maximum(force, 1e-6),
    ])
    found: FloatArray = _LARGEST * np.quantile(asked, 0.95, axis=1)
    return found


def _calibrate(model: PoseModel, samples: PoseSamples, modes: Float32Array, left: FloatArray) -> PoseErrorLaw:
    """The law of the errors of predictions at positions left out, whose corrections are `left` (N, m + 6)."""
    coordinates = model.hybrid.prior.coordinates
    signs, errors = [], []
    for i, base in enumerate(samples.base):
        unknowns = base.unknowns + left[i, :-6].astype(np.float32) @ modes
        wrench = base.contact.wrench + left[i, -6:]
        signs.append(model.signs(base, unknowns, wrench))
        errors.append(pose_errors(coordinates, unknowns, wrench[0], samples.truth[i], samples.true_wrench[i]))
    return PoseErrorLaw.fit(np.array(signs), np.array(errors))


def pose_errors(
    coordinates: ReducedCoordinates, unknowns: AnyArray, wrench: AnyArray, truth: AnyArray, true_wrench: AnyArray,
) -> FloatArray:
    """Errors in the order of `mixpinn.press.error_law.TARGETS`, shape (3,); unknowns (D,) and wrenches (6,)."""
    apart = coordinates.expand(unknowns) - coordinates.expand(truth)
    field = np.linalg.norm(apart[: coordinates.n_vertices], axis=1).mean()
    force = np.linalg.norm(wrench[:3] - true_wrench[:3])
    motion = coordinates.twists(unknowns)[:, :3] - coordinates.twists(truth)[:, :3]
    return np.array([field, force, np.linalg.norm(motion, axis=1).max(initial=0.0)])


def _joined(field: PoseCorrection, force: PoseCorrection) -> PoseCorrection:
    """The field's gain of one correction and the wrench's of another, on the features of the larger one."""
    larger = max(field, force, key=lambda found: len(found.scale))
    return PoseCorrection(
        field.modes, _widened(field.gain, len(field.scale), len(larger.scale)).astype(np.float32),
        _widened(force.wrench_gain, len(force.scale), len(larger.scale)), larger.scale, larger.largest,
    )


def _widened(gain: AnyArray, k: int, wide: int) -> FloatArray:
    """A gain on quadratic features of k coordinates as one on those of `wide` ≥ k, zero on the new ones."""
    first, second = np.triu_indices(wide)
    kept = np.concatenate([np.arange(wide) < k, (first < k) & (second < k)])
    widened = np.zeros((len(kept), gain.shape[1]))
    widened[kept] = gain
    return widened
