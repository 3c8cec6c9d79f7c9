"""Fit the hybrid model: modes from the training samples, a ridge regression, a calibrated error estimate."""

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mixpinn.base.arrays import Float32Array, FloatArray, IntArray
from mixpinn.base.errors import InputError
from mixpinn.base.progress import track
from mixpinn.fem import ElasticSystem, Material, default_solver
from mixpinn.models.equilibrium import Equilibrium
from mixpinn.models.error_estimate import ErrorEstimate, Signs
from mixpinn.models.hybrid import HybridModel, features
from mixpinn.models.modal_newton import ModalNewton
from mixpinn.models.modes import coefficients, principal_modes
from mixpinn.models.prior import ElasticPrior
from mixpinn.records import SampleTable


@dataclass(frozen=True)
class HybridConfig:
    """How the correction is made.

    Attributes:
        modes: number of modes m.
        coordinates: number of principal coordinates k of the prior's response.
        newton: use the Newton step as features.
        response: use the coordinates and their products as features.
        ridge: penalty of the regression, relative to the number of samples, features scaled to unit variance.
        mode_samples: samples from which the modes are taken, drawn from the training samples.
        seed: of that draw.
    """

    modes: int = 96
    coordinates: int = 12
    newton: bool = True
    response: bool = True
    ridge: float = 1e-5
    mode_samples: int = 2400
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("modes", "coordinates", "mode_samples"):
            if getattr(self, name) < 1:
                raise InputError(
                    f"hybrid.{name}", expected="at least 1", got=str(getattr(self, name)), fix="correct the setting",
                )
        if not (self.newton or self.response):
            raise InputError(
                "hybrid", expected="newton, response or both", got="neither", fix="switch one of them on",
            )


@dataclass(frozen=True, eq=False)
class HybridSamples:
    """Features and targets of S samples.

    Attributes:
        step: ν, shape (S, m).
        coordinates: a, shape (S, k).
        target: coefficients of what the prior misses, shape (S, m).
    """

    step: Float32Array
    coordinates: Float32Array
    target: Float32Array


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
                "samples", expected=f"samples of mesh {prior.mesh.hash()}", got=f"of mesh {table.mesh_hash}",
                fix="build the prior on the mesh of the simulations",
            )
    newton, readers = _modes(prior, materials, train, config)
    samples = hybrid_samples(newton, readers, train)
    model = HybridModel(newton, readers, fit_gain(samples, config))
    error = None
    if len(validation):
        signs, errors = error_signs(model, validation)
        error = ErrorEstimate.fit(signs, errors, training_coordinates=samples.coordinates)
    about = {
        "training_samples": len(train), "training_positions": len(np.unique(train.position_index)),
        "validation_samples": len(validation), "seconds": time.perf_counter() - began,
    }
    return HybridModel(newton, readers, model.gain, error, about)


def _modes(
    prior: ElasticPrior, materials: Sequence[Material], train: SampleTable, config: HybridConfig,
) -> tuple[ModalNewton, Float32Array]:
    """Modes of what the prior misses with their duals, and the readers of its principal coordinates."""
    rng = np.random.default_rng(config.seed)
    space, weights = prior.coordinates, prior.coordinates.weights
    chosen: IntArray = np.sort(rng.permutation(len(train))[: config.mode_samples])
    missed = np.empty((len(chosen), space.size), dtype=np.float32)
    response = np.empty_like(missed)
    for row, index in enumerate(track(chosen, "modes")):
        sample = train[int(index)]
        response[row], _ = prior.respond(sample.contact_nodes, sample.contact_displacement)
        missed[row] = space.project(sample.displacement) - response[row]
    modes = principal_modes(missed, weights, config.modes, rng=rng)
    principal = principal_modes(response, weights, config.coordinates, rng=rng)
    system, linear = ElasticSystem(prior.mesh, materials), default_solver()
    linear.factorize(system.tangent(system.rest_state(), project=True))
    duals = linear.solve(np.asfortranarray((weights**2 * modes).T, dtype=np.float64)).T
    newton = ModalNewton(
        prior, Equilibrium.of_materials(prior.mesh, materials), modes, np.ascontiguousarray(duals, dtype=np.float32),
        np.ascontiguousarray(((weights**2 * modes) @ prior.compliance.T).astype(np.float32)),
    )
    return newton, np.ascontiguousarray(((weights**2 * principal) @ prior.compliance.T).astype(np.float32))


def hybrid_samples(newton: ModalNewton, readers: Float32Array, table: SampleTable) -> HybridSamples:
    """Features and targets of all samples of a table."""
    prior, modes = newton.prior, newton.modes
    weights = prior.coordinates.weights
    found = HybridSamples(
        np.empty((len(table), len(modes)), np.float32), np.empty((len(table), len(readers)), np.float32),
        np.empty((len(table), len(modes)), np.float32),
    )
    for index in track(range(len(table)), "hybrid model"):
        sample = table[index]
        contact = prior.hold(sample.contact_nodes)
        force = contact.solve(sample.contact_displacement.ravel())
        response = prior.respond_to_forces(contact, force)
        found.coordinates[index] = readers[:, contact.rows] @ force.astype(np.float32)
        found.step[index] = newton.step(response, contact)
        found.target[index] = coefficients(modes, weights, prior.coordinates.project(sample.displacement) - response)
    return found


def fit_gain(samples: HybridSamples, config: HybridConfig) -> Float32Array:
    """Ridge regression of the target on the features that the configuration uses, shape (F, m)."""
    n_modes, n_coordinates = samples.step.shape[1], samples.coordinates.shape[1]
    gain = np.zeros((n_modes + n_coordinates * (n_coordinates + 3) // 2, samples.target.shape[1]))
    used = np.zeros(len(gain), dtype=bool)
    used[:n_modes], used[n_modes:] = config.newton, config.response
    rows = features(samples.step, samples.coordinates)[:, used].astype(np.float64)
    scale = np.maximum(rows.std(axis=0), 1e-12)
    rows = rows / scale
    normal = rows.T @ rows + config.ridge * len(rows) * np.eye(rows.shape[1])
    gain[used] = np.linalg.solve(normal, rows.T @ samples.target) / scale[:, None]
    return gain.astype(np.float32)


def error_signs(model: HybridModel, table: SampleTable) -> tuple[list[Signs], FloatArray]:
    """Signs of the error of every sample of a table, and the mean Euclidean error itself [mm], shape (S,)."""
    signs, errors = [], np.empty(len(table))
    for index in track(range(len(table)), "error estimate"):
        sample = table[index]
        state = model.solve(sample.contact_nodes, sample.contact_displacement)
        moved = model.expand(state, sample.contact_nodes, sample.contact_displacement)
        errors[index] = np.linalg.norm(moved - sample.displacement, axis=1).mean()
        signs.append(model.signs(state))
    return signs, errors
