"""The hybrid stage: simulations in, a predictor bundle with prior, correction and calibration out."""

import contextlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np

from mixpinn.base.errors import InputError
from mixpinn.base.files import hash_arrays
from mixpinn.base.rundir import finish_run, is_finished, run_scope, start_run
from mixpinn.dataset import SimulationStore, Split
from mixpinn.fem import ContactConfig, LocalRefinement, Material
from mixpinn.fem.scene_record import refinement_of
from mixpinn.press.contact import PriorContact
from mixpinn.press.domain import PoseDomain
from mixpinn.press.files import save_pose_model
from mixpinn.press.fine_skin import FineContact
from mixpinn.press.fit import collect, fit_pose, fitted_bend
from mixpinn.press.fit_forces import with_force_law
from mixpinn.press.model import PoseModel
from mixpinn.press.records import PoseContactConfig
from mixpinn.records import MESH_FILE, Probe, SampleTable
from mixpinn.records.error_budget import BUDGET_FILE
from mixpinn.reduced.fit import HybridConfig, fit_hybrid
from mixpinn.reduced.hybrid import BUNDLE, HYBRID_FILE, POSE_FILE, HybridModel
from mixpinn.stages.fine_skin import cached_fine_skin
from mixpinn.stages.prior import cached_prior
from mixpinn.stages.samples import choose_samples

SPLIT_FILE = "split.json"


@dataclass(frozen=True)
class HybridStageConfig:
    """What the hybrid model is made from.

    Attributes:
        hybrid: modes, features and regression.
        pose: also prepare predictions from the probe's pose, where the store tells the probe.
        pose_samples: training samples, spread evenly, that contact from the pose learns from.
    """

    hybrid: HybridConfig = field(default_factory=HybridConfig)
    pose: bool = True
    pose_samples: int = 2400


@run_scope()
def make_hybrid(
    store: SimulationStore, table: SampleTable, split: Split, config: HybridStageConfig, *, out: Path | str,
    materials: Sequence[Material] | None = None, held_out: str | None = None,
) -> HybridModel:
    """Fit the hybrid model on the training positions and calibrate it on the validation positions.

    Args:
        store: the simulations.
        table: their samples.
        split: of the positions.
        config: modes and regression.
        out: run directory: the predictor bundle; a finished one is loaded.
        materials: one for each tissue, where the store cannot tell them: a class of one's own.
        held_out: a hold-out by name whose samples neither fit nor calibration sees.

    Raises:
        InputError: `out` holds another run, or materials, joints or contact of the simulations are not recorded.
    """
    out, mesh = Path(out), store.mesh()
    samples = choose_samples(table, split, held_out)
    materials, restraints = store.materials() if materials is None else tuple(materials), store.restraints()
    probe = store.probe() if config.pose and len(samples.validation) else None
    contact = None if probe is None else store.contact()
    begun = start_run(
        out, "hybrid", config, seed=config.hybrid.seed, inputs={"store": store.folder / "store.json"},
        input_hashes={"mesh": mesh.hash(), "samples": hash_arrays(samples.train, samples.validation)},
    )
    if begun and is_finished(out) and (out / HYBRID_FILE).is_file():
        return HybridModel.load(out, mesh)
    prior = cached_prior(mesh, materials, touched=table.contact_nodes, restraints=restraints)
    model = fit_hybrid(
        prior, materials, table.select(samples.train), table.select(samples.validation), config.hybrid,
    )
    model = taught_with(model, store.refinement())
    split.save(out / SPLIT_FILE)
    save_bundle(model, out, tolerance=config.hybrid.compress)
    if probe is not None and contact is not None:
        some = samples.train[:: max(1, len(samples.train) // config.pose_samples)]
        few = samples.validation[:: max(1, 3 * len(samples.validation) // config.pose_samples)]
        save_pose_model(
            fit_pose_model(model, probe, contact, table.select(np.union1d(some, few)), materials), out,
        )
    finish_run(out, {"model": model.about})
    return model


def taught_with(model: HybridModel, refinement: LocalRefinement | None) -> HybridModel:
    """`model`, which says how cells were refined under the probe in its simulations."""
    if refinement is None:
        return model
    return replace(model, about={**model.about, "refinement": asdict(refinement), "refined_to": str(refinement)})


def plain_pose_model(model: HybridModel, probe: Probe, contact: ContactConfig) -> PoseModel:
    """Contact from the pose of `probe` on the model's prior, with nothing learned about it."""
    config = PoseContactConfig.of_order(model.mesh.order, gap=contact.gap, friction=contact.friction)
    solver = PriorContact.of_prior(model.prior, config)
    probes = (solver.field(probe),)
    return PoseModel(model, solver, probes, PoseDomain.of_mesh(model.mesh))


def fit_pose_model(
    model: HybridModel, probe: Probe, contact: ContactConfig, table: SampleTable, materials: Sequence[Material],
) -> PoseModel:
    """Contact from the pose with what the samples of `table` teach about it, and the errors to expect.

    Where they were solved on cells that are finer under the probe, forces are told on finer skin.
    """
    plain = plain_pose_model(model, probe, contact)
    if model.refinement is not None and model.mesh.order == 2:
        skin = cached_fine_skin(model.prior, materials, refinement_of(model.refinement))
        fine = FineContact.of_prior(skin, model.prior, stiffness=plain.contact.config.stiffness)
        plain = replace(plain, fine=fine)
    plain = fitted_bend(plain, table)
    return fit_pose(*with_force_law(plain, collect(plain, table)))


def save_bundle(model: HybridModel, out: Path, *, tolerance: float = 0.0) -> None:
    """Write all that `mixpinn.serving` needs: the mesh, the prior (packed), the correction and its calibration."""
    (out / BUDGET_FILE).unlink(missing_ok=True)  # of the model that was there before
    model.mesh.save(out / MESH_FILE)
    model.save(out, tolerance=tolerance, packed=True)


def is_whole(bundle: Path) -> bool:
    """Whether a sound bundle that takes poses lies there; one that was being written when all stopped is none."""
    with contextlib.suppress(InputError):
        BUNDLE.check(bundle)
        return BUNDLE.lists(bundle, POSE_FILE)
    return False
