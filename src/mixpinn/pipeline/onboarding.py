"""Onboarding: from label maps to a predictor that is usable after the prior and better after each round of poses."""

import os
import shutil
import time
from dataclasses import asdict, dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from mixpinn.base.arrays import IntArray
from mixpinn.base.errors import InputError, SolveError
from mixpinn.base.files import write_text
from mixpinn.base.progress import console
from mixpinn.base.rundir import finish_run, run_scope, start_run
from mixpinn.base.validated import load_record, save_record
from mixpinn.dataset import SimulationsAhead, SimulationStore, Split, build_sample_table, farthest_first
from mixpinn.evaluation import evaluate
from mixpinn.evaluation.onboarding_report import draw_rounds, rounds_report
from mixpinn.fem import LocalRefinement, Scene
from mixpinn.press.files import save_pose_model
from mixpinn.press.model import PoseModel
from mixpinn.records import SampleTable, TissueMesh
from mixpinn.records.answer import discretisation_of
from mixpinn.reduced.equilibrium import Equilibrium
from mixpinn.reduced.fit import HybridConfig, fit_hybrid
from mixpinn.reduced.hybrid import HybridModel
from mixpinn.reduced.prior import ElasticPrior, probed_nodes
from mixpinn.serving.bundle_budget import keep_budget, load_budget
from mixpinn.stages.anatomy import AnatomyConfig, make_anatomy
from mixpinn.stages.budget.make import make_budget
from mixpinn.stages.budget.variants import BudgetConfig
from mixpinn.stages.evaluation import Background, EvaluationConfig, evaluate_models
from mixpinn.stages.hybrid import SPLIT_FILE, fit_pose_model, is_whole, plain_pose_model, save_bundle, taught_with
from mixpinn.stages.mesh import PATIENT_CELLS, MeshConfig, make_mesh
from mixpinn.stages.prior import cached_prior
from mixpinn.stages.restraints import describe
from mixpinn.stages.simulation import (
    SimulationConfig,
    begin_simulations,
    bones_left_out,
    failed_for_valleys,
    for_patients,
    make_scene,
)

BUNDLE = "bundle"
_ROUNDS = "rounds.json"


@dataclass(frozen=True)
class OnboardingConfig:
    """From label maps to a predictor.

    Attributes:
        anatomy: label maps.
        mesh: tetrahedra.
        simulation: mechanics, probe, and the poses to choose from; by default each pose is solved on cells that are
            refined under the probe.
        hybrid: modes and regression.
        poses: how many poses are simulated in all; 0 stops at the prior.
        first_round: poses of the first round; each further one doubles the number of poses, until the last, which has
            as many again and tests what was learned from all before.
        pictures: render the last round's typical prediction.
        budget: of the error estimate against the converged solution, which goes into bundle and report.
        budget_minutes: no further solve of it begins after this time; 0 leaves it out.
    """

    anatomy: AnatomyConfig = field(default_factory=AnatomyConfig)
    mesh: MeshConfig = PATIENT_CELLS
    simulation: SimulationConfig = field(default_factory=lambda: SimulationConfig(refinement=LocalRefinement()))
    hybrid: HybridConfig = field(default_factory=HybridConfig)
    poses: int = 32
    first_round: int = 8
    pictures: bool = True
    budget: BudgetConfig = field(default_factory=lambda: BudgetConfig(poses=1, sensitivity=False))
    budget_minutes: float = 4.0

    def __post_init__(self) -> None:
        for name, least in (("poses", 0), ("first_round", 4)):
            if getattr(self, name) < least:
                raise InputError(
                    name, expected=f"at least {least}", got=str(getattr(self, name)), fix="correct the setting",
                )


@run_scope()
def onboard(config: OnboardingConfig, *, out: Path | str) -> Path:
    """Make a predictor for one anatomy; the same call continues where it was stopped.

    ``bundle/`` can be loaded as soon as the prior is there and is replaced after every round. A round's poses are
    those farthest from all before; the model predicts them before it learns from them, so that each round is a test
    on poses never seen. The last round stays out of the fit and is what the report shows.

    Args:
        config: what is done.
        out: run directory: ``anatomy/``, ``mesh/``, ``simulation/``, ``bundle/``, ``evaluation/``, ``rounds.json``,
            ``onboarding.md`` and ``.png``.

    Returns:
        Folder of the bundle.

    Raises:
        InputError: bad input, or `out` holds another run.
    """
    out = Path(out)
    settings = asdict(config)
    for later in ("poses", "pictures", "budget", "budget_minutes"):  # decide how far, not what
        del settings[later]
    for stage in ("simulation", "mesh"):
        del settings[stage]["timeout"]  # decides when
    start_run(out, "onboard", settings)
    clock = _Clock(out / _ROUNDS)
    label_map = make_anatomy(config.anatomy, out=out / "anatomy").label_map
    read = clock.seconds()
    mesh = make_mesh(label_map, config.mesh, out=out / "mesh").mesh
    if config.anatomy.source != "phantom":
        config = replace(config, simulation=for_patients(config.simulation, label_map.soft_names))
    scene = make_scene(mesh, config.simulation)
    model = _prior_bundle(scene, out / BUNDLE)
    clock.note({"stage": "prior", "minutes": clock.seconds() / 60.0, "after_labels": clock.seconds() - read})
    console.print(f"The elastic prior is ready: {out / BUNDLE} can be used; simulations make it better.")
    if config.poses:
        _learn(model, mesh, config, clock, out)
    refined_to = "" if scene.refinement is None else str(scene.refinement)
    told = {"Discretisation": discretisation_of(scene.mesh, refined_to), **describe(scene.mesh, scene.restraints)}
    if left := bones_left_out(scene.mesh, config.simulation, scene.probe):
        told["Ends of the scan"] = left
    budget = load_budget(out / BUNDLE, scene.mesh)
    write_text(out / "onboarding.md", rounds_report(
        clock.rounds, mesh_nodes=mesh.n_points, body=told, budget=budget, minutes=clock.seconds() / 60.0,
    ))
    draw_rounds(clock.rounds, out / "onboarding.png")
    finish_run(out, {"rounds": clock.rounds, "minutes": clock.seconds() / 60.0})
    return out / BUNDLE


def _prior_bundle(scene: Scene, bundle: Path) -> HybridModel:
    model = HybridModel.of_prior(
        cached_prior(scene.mesh, scene.materials, restraints=scene.restraints),
        Equilibrium.of_materials(scene.mesh, scene.materials, scene.restraints),
    )
    if not is_whole(bundle):
        save_bundle(model, bundle)
        save_pose_model(plain_pose_model(model, scene.probe, scene.contact), bundle)
    return model


def _learn(model: HybridModel, mesh: TissueMesh, config: OnboardingConfig, clock: "_Clock", out: Path) -> None:
    """Rounds of simulation, test and fit."""
    scene, store = begin_simulations(mesh, config.simulation, out=out / "simulation")
    ordered = farthest_first(store.poses)[: config.poses]
    seen, workers = 0, config.simulation.workers or os.cpu_count() or 1
    with SimulationsAhead(
        scene, ordered, store, workers=workers, threads=scene.solver.threads or 1, timeout=config.simulation.timeout,
    ) as ahead:
        for end in round_ends(len(ordered), config.first_round):
            ahead.wait(ordered[seen:end])
            _tell_failures(store, ordered[seen:end])
            table = build_sample_table(store, poses=ordered[seen:end])
            if not seen:  # nothing is learned yet: the prior takes what was touched, as the fit does
                prior = _taking(model.prior, scene, table)
                model = HybridModel.of_prior(prior, model.newton.equilibrium) if prior is not model.prior else model
            table = _within(table, model.prior.nodes)
            entry: dict[str, Any] = {"stage": f"{end} poses", "poses": end - seen, "samples": len(table)}
            for name, candidate in (("prior", model.prior), ("model", model)):
                found = evaluate(candidate, table, scene.mesh, split=f"poses {seen + 1} to {end}")
                entry[f"{name}_mee"] = float(found.metrics["mee"].mean())
            entry["correction"] = model.about.get("correction", "none")
            entry["no_motion"] = float(found.metrics["mean_displacement"].mean())
            if end < len(ordered):
                known = build_sample_table(store, poses=ordered[:end])
                model, pose = _fit(model, scene, known, ordered[:end], config)
                save_bundle(model, out / BUNDLE, tolerance=config.hybrid.compress)
                save_pose_model(pose, out / BUNDLE)
            clock.note({**entry, "minutes": clock.seconds() / 60.0})
            console.print(
                f"{end} poses: the {end - seen} new ones are predicted to {entry['model_mee']:.3f} mm (prior "
                f"{entry['prior_mee']:.3f} mm, no motion {entry['no_motion']:.2f} mm)."
            )
            seen = end
    _assess(config, out)
    _report(store, _within(table, probed_nodes(scene.mesh)), config, out)  # baselines have no other nodes


def round_ends(poses: int, first: int) -> list[int]:
    """After how many poses each round ends, for so many `poses` in all and `first` in the first round."""
    ends = [min(first, poses)]
    while 2 * ends[-1] < poses - first:
        ends.append(2 * ends[-1])
    return sorted({*ends, max(poses - first, ends[-1]), poses})


def _tell_failures(store: SimulationStore, poses: Any) -> None:
    if failed := sum(len(store.status(pose).failed_steps) for pose in poses):
        why = failed_for_valleys(store)
        console.print(f"{failed} steps found no equilibrium and are left out{why and ': '}{why}", soft_wrap=True)


def _samples_of(table: SampleTable, poses: Any) -> SampleTable:
    """The samples of some poses."""
    wanted = {(pose.position_index, pose.rotation_deg) for pose in poses}
    return table.select(np.array([
        (int(position), float(turn)) in wanted
        for position, turn in zip(table.position_index, table.rotation_deg, strict=True)
    ], dtype=bool))


def _taking(prior: ElasticPrior, scene: Scene, table: SampleTable) -> ElasticPrior:
    """`prior`, or one of more nodes where samples touch others: beside a cap of the crop, skin that faces sideways."""
    if not len(np.setdiff1d(table.contact_nodes, prior.nodes)):
        return prior
    touched = np.union1d(prior.nodes, table.contact_nodes)
    return cached_prior(scene.mesh, scene.materials, touched=touched, restraints=scene.restraints)


def _within(table: SampleTable, nodes: IntArray) -> SampleTable:
    """The samples that touch no node but these; says how many are left out."""
    known = np.isin(table.contact_nodes, nodes)
    whole = np.array([known[a:b].all() for a, b in pairwise(table.contact_offsets)], dtype=bool)
    if whole.all() or not whole.any():
        return table
    left = int((~whole).sum())
    console.print(f"{left} of {len(table)} samples touch skin beside the probed one: not in the test.")
    return table.select(whole)


def _fit(
    model: HybridModel, scene: Scene, table: SampleTable, poses: Any, config: OnboardingConfig,
) -> tuple[HybridModel, PoseModel]:
    """Fit on these poses, every fourth of them kept for calibration."""
    held = [pose for index, pose in enumerate(poses) if index % 4 == 3]
    fitted = [pose for index, pose in enumerate(poses) if index % 4 != 3]
    prior = _taking(model.prior, scene, table)
    train, calibration = _samples_of(table, fitted), _samples_of(table, held)
    hybrid = taught_with(fit_hybrid(prior, scene.materials, train, calibration, config.hybrid), scene.refinement)
    return hybrid, fit_pose_model(
        hybrid, scene.probe, scene.contact, _samples_of(table, poses), scene.materials,
    )


def _assess(config: OnboardingConfig, out: Path) -> None:
    """How far the bundle's answers are from the converged solution, into the bundle."""
    if not config.budget_minutes:
        return
    try:
        found = make_budget(out / BUNDLE, config.budget, out=out / "budget", minutes=config.budget_minutes)
    except (InputError, SolveError) as error:  # a predictor without its budget is still a predictor
        console.print(f"no error budget: {error}", soft_wrap=True)
        return
    keep_budget(found, out / BUNDLE)
    console.print(found.sentence, soft_wrap=True)


def _report(store: SimulationStore, last: SampleTable, config: OnboardingConfig, out: Path) -> None:
    """Pictures and tables of the bundle on the last round, whose poses it has not been fitted on."""
    positions = np.unique(last.position_index)
    others = np.setdiff1d(np.arange(len(store.positions)), positions)
    split = Split("last round", others, np.empty(0, dtype=np.int64), positions)
    split.save(out / BUNDLE / SPLIT_FILE)
    # What a run that was stopped has left there belongs to its own bundle, which has been fitted anew.
    shutil.rmtree(out / "evaluation", ignore_errors=True)
    _, page = evaluate_models(
        store, last, split, [out / BUNDLE], EvaluationConfig(pictures=config.pictures), out=out / "evaluation",
        background=Background(
            title="A predictor for one anatomy",
            introduction="The elastic prior of this anatomy with a correction learned from simulated poses, tested on "
                         "the poses of the last round, which it was not fitted on.",
        ),
    )
    console.print(f"Report: {page}")


@dataclass(frozen=True)
class _Rounds:
    """What ``rounds.json`` holds."""

    seconds: float
    rounds: list[dict[str, Any]]


class _Clock:
    """Wall time over all sessions, and what was reached when."""

    def __init__(self, file: Path) -> None:
        self.file, self._began = file, time.perf_counter()
        remake = "delete it: the rounds are tested again"
        kept = load_record(_Rounds, file, remake=remake) if file.exists() else _Rounds(0.0, [])
        self._before, self.rounds = kept.seconds, kept.rounds

    def seconds(self) -> float:
        """Since the first session began, pauses not counted [s]."""
        return self._before + time.perf_counter() - self._began

    def note(self, entry: dict[str, Any]) -> None:
        """Keep an entry; one of an earlier session for the same stage stands."""
        if all(entry["stage"] != known["stage"] for known in self.rounds):
            self.rounds.append(entry)
        save_record(self.file, {"seconds": self.seconds(), "rounds": self.rounds})
