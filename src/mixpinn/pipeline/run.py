"""The whole pipeline: label maps → mesh → simulations → trained models → report."""

import time
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import TypeVar

from mixpinn.base.progress import console
from mixpinn.base.rundir import finish_run, run_scope, start_run
from mixpinn.base.validated import load_record, save_record
from mixpinn.evaluation import Table, results_table
from mixpinn.pipeline.config import RunConfig
from mixpinn.stages.anatomy import AnatomyResult, make_anatomy
from mixpinn.stages.evaluation import Background, evaluate_models
from mixpinn.stages.fit import fit_model
from mixpinn.stages.mesh import MeshResult, make_mesh
from mixpinn.stages.samples import load_samples
from mixpinn.stages.setup_tables import fidelity_table, findings_table, quality_table
from mixpinn.stages.simulation import for_patients, make_simulations
from mixpinn.training import settle_arithmetic

T = TypeVar("T")
TIMES = "stage_seconds.json"


class _Clock:
    """Wall time of each stage, kept over interruptions; a stage found finished keeps the time of its first run."""

    def __init__(self, path: Path) -> None:
        self._path = path
        remake = "delete it: only the times are lost"
        self.seconds = load_record(dict[str, float], path, remake=remake) if path.exists() else {}

    def measure(self, name: str, work: Callable[[], T]) -> T:
        console.rule(name)
        start = time.perf_counter()
        result = work()
        self.seconds[name] = max(self.seconds.get(name, 0.0), time.perf_counter() - start)
        save_record(self._path, self.seconds)
        return result


@run_scope()
def run_pipeline(config: RunConfig, *, out: Path | str, threads: int | None = None) -> Path:
    """Run every stage into subfolders of `out`; a run begun there before continues.

    Args:
        config: all stages.
        out: run directory: ``anatomy/``, ``mesh/``, ``simulation/``, ``models/NAME/``, ``evaluation/``.
        threads: CPU threads of training and prediction; None takes every core.

    Returns:
        Path of the HTML report.

    Raises:
        InputError: bad input at any stage; stages before it are kept.
    """
    out = Path(out)
    settings = asdict(config)
    for stage, later in (("simulation", "workers"), ("simulation", "timeout"), ("mesh", "timeout")):
        del settings[stage][later]  # they decide when, not what
    start_run(out, "run", settings)
    settle_arithmetic()  # before anything is solved in this process
    clock = _Clock(out / TIMES)
    anatomy = clock.measure("Anatomy", lambda: make_anatomy(config.anatomy, out=out / "anatomy"))
    meshed = clock.measure("Mesh", lambda: make_mesh(anatomy.label_map, config.mesh, out=out / "mesh"))
    simulation = config.simulation
    if config.anatomy.source != "phantom":
        simulation = for_patients(simulation, anatomy.label_map.soft_names)
    store, summary = clock.measure(
        "Simulation", lambda: make_simulations(meshed.mesh, simulation, out=out / "simulation"),
    )
    console.print(summary.markdown())
    table, split = load_samples(store, config.split)
    models = config.models
    if threads is not None:
        models = replace(models, train=replace(models.train, threads=threads))
    split.save(out / "split.json")
    for name in config.models.names:
        clock.measure(f"Training {name}", lambda name=name: fit_model(  # type: ignore[misc]
            store, table, split, name, models, out=out / "models" / name,
        ))
    background = Background(
        title=config.title, introduction=_introduction(config, meshed, len(store.poses), len(table)),
        setup=_setup(anatomy, meshed), stage_seconds=dict(clock.seconds), summary=summary,
        provenance={"Anatomy": {"label map": anatomy.label_map.hash()}},
    )
    evaluations, report = clock.measure("Evaluation", lambda: evaluate_models(
        store, table, split, [out / "models" / name for name in config.models.names], config.evaluation,
        out=out / "evaluation", background=background, threads=threads,
    ))
    finish_run(out, {
        "report": str(report), "stage_seconds": clock.seconds,
        "mee": {evaluation.model: float(evaluation.metrics["mee"].mean()) for evaluation in evaluations},
    })
    console.print(results_table(evaluations, with_paper=config.evaluation.with_paper).rich())
    console.print(f"Report: {report}")
    return report


def _introduction(config: RunConfig, meshed: MeshResult, poses: int, samples: int) -> str:
    mesh = meshed.mesh
    source = "the built-in lumbar phantom" if config.anatomy.source == "phantom" else "the label maps of one patient"
    return (
        f"From {source}, a tetrahedral mesh of {mesh.n_points:,} nodes with {mesh.n_parts} rigid parts was built. An "
        f"ultrasound probe was pressed into it in {poses} poses by a finite-element solver with finite strains, rigid "
        f"bodies and frictional contact, which gave {samples:,} samples. The models below learned from most probe "
        "positions and are tested on positions that they have never seen."
    )


def _setup(anatomy: AnatomyResult, meshed: MeshResult) -> tuple[Table, ...]:
    tables = [quality_table(meshed.quality)]
    if meshed.fidelity is not None:
        tables.append(fidelity_table(meshed.fidelity))
    if anatomy.findings:
        tables.append(findings_table(anatomy.findings))
    return tuple(tables)
