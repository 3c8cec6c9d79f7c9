"""Fit the hybrid model: modes from the training samples, a ridge regression, a calibrated error estimate."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mixpinn.base.arrays import AnyArray, Float32Array, FloatArray, IntArray
from mixpinn.base.errors import InputError
from mixpinn.base.progress import track
from mixpinn.fem import ElasticSystem, Material, default_solver
from mixpinn.records import SampleTable
from mixpinn.records.answer import discretisation_of
from mixpinn.reduced.compliance.rows import Rows
from mixpinn.reduced.correction import REACH, WIDER, choose_correction, learned_share
from mixpinn.reduced.drawn_steps import drawn_steps
from mixpinn.reduced.equilibrium import Equilibrium
from mixpinn.reduced.error_estimate import ErrorEstimate, Signs
from mixpinn.reduced.hybrid import HybridModel, features
from mixpinn.reduced.modal_newton import ModalNewton
from mixpinn.reduced.modes import coefficients, excited_modes, principal_modes
from mixpinn.reduced.near_cells import NearCells, cells_near
from mixpinn.reduced.prior import ElasticPrior


@dataclass(frozen=True)
class HybridConfig:
    """How the correction is made.

    Attributes:
        modes: number of modes m at most; those that hold far less than the regression misses are left out.
        coordinates: number of principal coordinates k of the prior's response.
        newton: use the Newton step as features.
        response: use the coordinates and their products as features.
        ridge: penalties of the regression to choose from, relative to the number of samples, features scaled to unit
            variance; the one that cross-validation over training positions finds best is taken.
        compress: with a positive value, the bundle holds the prior as a low-rank product with at most this relative
            error (Frobenius norm) instead of the whole matrix.
        mode_samples: samples from which the modes are taken, drawn from the training samples.
        drawn_contacts: contacts without simulation whose Newton steps the modes are taken from as well
            (`mixpinn.reduced.drawn_steps`).
        seed: of that draw.
    """

    modes: int = 96
    coordinates: int = 12
    newton: bool = True
    response: bool = True
    ridge: tuple[float, ...] = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0)
    compress: float = 0.0
    mode_samples: int = 2400
    drawn_contacts: int = 600
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("modes", "coordinates", "mode_samples"):
            if getattr(self, name) < 1:
                raise InputError(
                    f"hybrid.{name}", expected="at least 1", got=str(getattr(self, name)), fix="correct the setting",
                )
        if self.drawn_contacts < 0:
            raise InputError(
                "hybrid.drawn_contacts", expected="0 or more", got=str(self.drawn_contacts), fix="correct the setting",
            )
        if not (self.ridge and min(self.ridge) > 0.0):
            raise InputError(
                "hybrid.ridge", expected="positive numbers", got=str(self.ridge), fix="correct the setting",
            )
        if not (self.newton or self.response):
            raise InputError(
                "hybrid", expected="newton, response or both", got="neither", fix="switch one of them on",
            )


@dataclass(frozen=True, eq=False)
class PreparedSamples:
    """What physics says of S samples; modes and regressions follow from it by dense products.

    Attributes:
        response: of the prior [mm, rad], shape (S, D).
        missed: what the prior misses [mm, rad], shape (S, D).
        residual: unbalanced force at the response, zero on the held unknowns [N, N mm], shape (S, D).
        rows: rows of the contact nodes in the compliance, shapes (3 l,).
        force: of the prior on the contact nodes [N], shapes (3 l,).
        held: W_LL⁻¹ C_L r, the force that keeps them in place during the Newton step [N], shapes (3 l,).
        position: index of the probe position, shape (S,).
    """

    response: Float32Array
    missed: Float32Array
    residual: Float32Array
    rows: list[IntArray]
    force: list[FloatArray]
    held: list[FloatArray]
    position: IntArray

    def __len__(self) -> int:
        return len(self.position)

    def select(self, chosen: AnyArray) -> "PreparedSamples":
        """The samples at indices (or where the mask) `chosen`."""
        index = np.arange(len(self))[chosen]
        return PreparedSamples(
            self.response[index], self.missed[index], self.residual[index], [self.rows[i] for i in index],
            [self.force[i] for i in index], [self.held[i] for i in index], self.position[index],
        )

    def steps(self, newton: ModalNewton) -> Float32Array:
        """ν of every sample, shape (S, m)."""
        kept = np.stack([
            newton.coupling[:, rows] @ held.astype(np.float32) for rows, held in zip(self.rows, self.held, strict=True)
        ])
        step: Float32Array = kept - self.residual @ newton.duals.dense().T
        return step

    def coordinates(self, readers: Float32Array) -> Float32Array:
        """a of every sample, shape (S, k)."""
        return np.stack([
            readers[:, rows] @ force.astype(np.float32) for rows, force in zip(self.rows, self.force, strict=True)
        ])


def prepare_samples(prior: ElasticPrior, newton: ModalNewton, table: SampleTable) -> PreparedSamples:
    """Ask the two physical models about every sample of a table; the table's prediction needs no training."""
    space, size = prior.coordinates, (len(table), prior.coordinates.size)
    found = PreparedSamples(
        np.empty(size, np.float32), np.empty(size, np.float32), np.empty(size, np.float32), [], [], [],
        table.position_index,
    )
    for index in track(range(len(table)), "prior and residual"):
        sample = table[index]
        contact = prior.hold(sample.contact_nodes)
        force = contact.solve(sample.contact_displacement.ravel())
        response, residual = found.response[index], found.residual[index]
        response[:] = prior.respond_to_forces(contact, force)
        residual[:] = newton.residual(response, contact)
        found.missed[index] = space.project(sample.displacement) - response
        found.rows.append(contact.rows)
        found.force.append(force)
        found.held.append(contact.solve(prior.compliance.read(contact.rows, residual)))
    return found


def fit_hybrid(
    prior: ElasticPrior, materials: Sequence[Material], train: SampleTable, validation: SampleTable,
    config: HybridConfig | None = None,
) -> HybridModel:
    """Fit modes and gain on `train`, calibrate the error estimate on `validation`.

    Args:
        prior: of the samples' mesh, prepared for all their contact nodes.
        materials: one for each tissue of the mesh.
        train: training samples.
        validation: samples at other positions; without any the error estimate is left out.
        config: how.

    Raises:
        InputError: samples of another mesh, or materials that the residual is not there for.
    """
    config, began = config or HybridConfig(), time.perf_counter()
    for table in (train, validation):
        if table.mesh_hash != prior.mesh.hash():
            raise InputError(
                "samples", expected=f"samples of {discretisation_of(prior.mesh)}", got=f"those of {table.made_on}",
                fix="build the prior on the mesh of the simulations",
            )
    newton = HybridModel.of_prior(prior, Equilibrium.of_materials(prior.mesh, materials, prior.restraints)).newton
    newton = replace(newton, near=cells_near(prior.mesh, newton.equilibrium, prior.nodes))
    prepared = prepare_samples(prior, newton, train)
    model = fit_correction(prior, materials, prepared, config, newton.near)
    error = None
    if len(validation):
        signs, errors = error_signs(model, validation)
        error = ErrorEstimate.fit(signs, errors, training_coordinates=prepared.coordinates(model.readers))
    about = {
        **model.about, "training_samples": len(train), "training_positions": len(np.unique(train.position_index)),
        "validation_samples": len(validation), "seconds": time.perf_counter() - began,
    }
    return replace(model, error=error, about=about)


def fit_correction(
    prior: ElasticPrior, materials: Sequence[Material], prepared: PreparedSamples, config: HybridConfig,
    near: NearCells | None = None,
) -> HybridModel:
    """Modes and gain from training samples, prepared with `near`; the model is not calibrated yet."""
    rng = np.random.default_rng(config.seed)
    weights = prior.coordinates.weights
    drawn = prepared.select(np.sort(rng.permutation(len(prepared))[: config.mode_samples]))
    wide = principal_modes(drawn.response, weights, WIDER * config.coordinates, rng=rng)
    principal = excited_modes(wide[: config.coordinates], weights, drawn.response)
    tied = prior.restraints
    system = ElasticSystem(
        prior.mesh, materials, joints=tied.joints, foundations=tied.foundations, membrane=tied.membrane,
    )
    linear = default_solver()
    linear.factorize(system.tangent(system.rest_state(), project=True))
    equilibrium = Equilibrium.of_materials(prior.mesh, materials, tied)
    steps = _DRAWN_SHARE * drawn_steps(prior, equilibrium, linear, config.drawn_contacts)
    steps = _no_larger(steps, drawn.missed, weights)
    modes = principal_modes(np.concatenate([drawn.missed, steps]), weights, config.modes, rng=rng)
    duals = linear.solve(np.asfortranarray((weights**2 * modes).T, dtype=np.float64)).T
    newton = ModalNewton(
        prior, equilibrium, Rows.of(modes), Rows.of(duals),
        np.ascontiguousarray(prior.compliance.times(weights**2 * modes)), near,
    )
    readers = np.ascontiguousarray(prior.compliance.times(weights**2 * principal))
    step, coordinates = prepared.steps(newton), prepared.coordinates(readers)
    target, of_drawn = (coefficients(modes, weights, fields) for fields in (prepared.missed, steps))
    responses = coefficients(wide, weights, prepared.response)

    def choose(m: int) -> tuple[Float32Array, dict[str, Any]]:
        return choose_correction(
            step[:, :m], coordinates, target[:, :m], prepared.position, drawn=of_drawn[:, :m],
            responses=responses, newton=config.newton, response=config.response, penalties=config.ridge,
        )

    gain, chosen = choose(len(modes))
    enough = _enough_modes(target, chosen["cross_validation"])
    if enough < len(modes):
        gain, chosen = choose(enough)
    newton, step, length = newton.leading(enough), step[:, :enough], float(chosen["newton_length"])
    return HybridModel(
        newton, readers, gain, about=chosen, newton_length=length,
        reach=REACH * learned_share(step, features(step, coordinates) @ gain, length),
    )


_NEGLECTED = 0.25
"""What modes that are left out may hold, of the error at positions left out: adds at most 3 % to that error."""
_FEWEST = 16
"""So many modes are kept in any case."""


def _enough_modes(target: Float32Array, error: float) -> int:
    """How many of m modes are worth their time, where samples have coefficients `target` (S, m) in them.

    Args:
        target: see above; the modes from the largest on.
        error: norm of the error of the coefficients that a regression leaves.
    """
    beyond = np.sqrt(np.cumsum(np.square(target).mean(axis=0, dtype=np.float64)[::-1])[::-1])
    needed = int(np.count_nonzero(beyond > _NEGLECTED * error))
    return min(target.shape[1], max(needed, _FEWEST))


_DRAWN_SHARE = 0.5
"""What a Newton step of a drawn contact counts for beside what is missed on a simulation; chosen by hand."""


def _no_larger(fields: Float32Array, known: Float32Array, weights: Float32Array) -> Float32Array:
    """Fields (N, D), those cut back that are larger than any of the known ones (S, D)."""
    size, most = (np.linalg.norm(rows * weights, axis=1) for rows in (fields, known))
    return fields * np.minimum(1.0, most.max() / np.maximum(size, 1e-12))[:, None].astype(np.float32)


def error_signs(model: HybridModel, table: SampleTable) -> tuple[list[Signs], FloatArray]:
    """Signs of the error of every sample of a table, and the mean Euclidean error of the vertices [mm], (S,)."""
    signs, errors = [], np.empty(len(table))
    vertices = slice(model.mesh.n_points)
    for index in track(range(len(table)), "error estimate"):
        sample = table[index]
        state = model.solve(sample.contact_nodes, sample.contact_displacement)
        moved = model.expand(state)
        errors[index] = np.linalg.norm((moved - sample.displacement)[vertices], axis=1).mean()
        signs.append(model.signs(state))
    return signs, errors
