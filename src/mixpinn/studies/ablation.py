"""The paper's experiments in one command: simulations, every row's training, tests and tables."""

import json
import os
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from mixpinn.base.arrays import IntArray
from mixpinn.base.config import build_config
from mixpinn.base.errors import InputError, MixpinnError
from mixpinn.base.files import hash_arrays
from mixpinn.base.progress import console
from mixpinn.base.rundir import finish_run, read_run, run_scope, start_run
from mixpinn.base.validated import save_record
from mixpinn.dataset import SimulationStore, Split
from mixpinn.evaluation import ZeroModel
from mixpinn.networks import MIXPINN
from mixpinn.records import MESH_FILE, SampleTable, TissueMesh
from mixpinn.stages.anatomy import AnatomyConfig, make_anatomy, source_settings
from mixpinn.stages.mesh import load_mesh, make_mesh
from mixpinn.stages.prior import cached_prior
from mixpinn.stages.samples import load_samples
from mixpinn.stages.simulation import STORE, make_simulations, settings_of
from mixpinn.studies.ablation_config import AblationConfig
from mixpinn.studies.ablation_jobs import SAMPLES, SETS, evaluate_once, evaluation_path, plan_jobs, test_set_names
from mixpinn.studies.ablation_pool import check_scheduling, is_done, run_jobs
from mixpinn.studies.ablation_report import write_ablation_report
from mixpinn.studies.ablation_sets import own_sets, probe_set, save_sets, seen_in_training

BASELINES = ("No motion", "Elastic prior")
"""The two rows of every table that need no training."""


@run_scope()
def run_ablation(
    source: Path | str, config: AblationConfig, *, out: Path | str, workers: int = 0, threads: int = 1,
    scheduler: str | None = None, devices: int = 1, tables_only: bool = False,
) -> Path:
    """Train and test every row of the table in the run directory `out`; an interrupted table continues.

    Args:
        source: label maps (a folder or ``phantom``), a mesh (a folder of ``mixpinn mesh`` or a ``.vtu``), or
            simulations (a folder of ``mixpinn simulate``), made with the settings of `config`.
        config: rows, seeds, budgets and tests.
        out: ``anatomy/``, ``mesh/`` and ``simulation/`` where they are made here, ``samples/``, ``rows/NAME/``,
            ``evaluations/``, and the tables ``results.json``, ``.csv`` and ``.md`` with their pictures.
        workers: processes on this machine; 0 takes every core.
        threads: of each process.
        scheduler: address of a Dask scheduler to use instead, for the simulations and the trainings.
        devices: processes of each training, each with a device of its own.
        tables_only: train nothing and write the tables of the runs that are finished.

    Returns:
        Path of ``results.md``.

    Raises:
        InputError: bad input; what is finished is kept.
        MixpinnError: a training failed; the others are finished, and their tables written.
    """
    workers = workers or os.cpu_count() or 1
    check_scheduling(workers=workers, devices=devices)
    out, config = Path(out), replace(config, train=replace(config.train, threads=threads))
    if tables_only:
        return write_finished(out, config)
    store = _simulations(source, config, out=out, workers=workers, scheduler=scheduler)
    table, split = load_samples(store, config.split)
    mesh = store.mesh()
    start_run(out, "ablate", _settings(config), input_hashes={
        "mesh": mesh.hash(), "store": store.identity, "split": hash_arrays(*split.parts.values()),
    })
    train = _prepare(table, split, store, config, mesh, out=out, scheduler=scheduler)
    jobs = plan_jobs(config, split, train)
    _baselines(store, mesh, table, out)
    failed = run_jobs(
        jobs, out, workers=workers, threads=threads, scheduler=scheduler, devices=devices, timeout=config.timeout,
    )
    finished = [job for job in jobs if job.name not in failed]
    report = write_ablation_report(out, finished, config, mesh)
    if failed:
        name, message = next(iter(failed.items()))
        raise MixpinnError(f"{len(failed)} of {len(jobs)} runs failed, the first {name}: {message}")
    finish_run(out, {"runs": [job.name for job in jobs]})
    console.print(f"Tables: {report}")
    return report


def write_finished(out: Path, config: AblationConfig) -> Path:
    """Write the tables of those runs in `out` that are finished; a table that is being trained is left alone.

    Returns:
        Path of ``results.md``.

    Raises:
        InputError: no table there, one with other settings, or nothing finished.
    """
    before = read_run(out)
    if before.get("config") != json.loads(json.dumps(_settings(config))):
        raise InputError(
            str(out), expected="a table with these settings", got="one with others",
            fix="give the settings that it was begun with",
        )
    jobs = plan_jobs(config, Split.load(out / "split.json"), SampleTable.load(out / SAMPLES / "train"))
    mesh = TissueMesh.load(out / SAMPLES / MESH_FILE)
    finished = [job for job in jobs if is_done(out, job)]
    console.print(f"{len(finished)} of {len(jobs)} runs are finished")
    return write_ablation_report(out, finished, config, mesh)


def _settings(config: AblationConfig) -> dict[str, Any]:
    """What decides the figures, besides the simulations, whose own identity says what they were made of."""
    settings = asdict(config)
    for name in ("anatomy", "mesh", "simulation", "timeout"):
        del settings[name]
    settings["train"] = asdict(config.train.for_model(MIXPINN))
    del settings["train"]["threads"]
    return settings


def _simulations(
    source: Path | str, config: AblationConfig, *, out: Path, workers: int, scheduler: str | None,
) -> SimulationStore:
    """Find the simulations, or make them, their mesh and the anatomy before."""
    path = Path(source)
    for candidate in (path / STORE, path):
        if (candidate / "store.json").is_file():
            return SimulationStore.open(candidate)
    if path.suffix == ".vtu" or (path / MESH_FILE).is_file():
        mesh = load_mesh(path)
    else:
        anatomy = build_config(AnatomyConfig, asdict(config.anatomy), source_settings(source))
        label_map = make_anatomy(anatomy, out=out / "anatomy").label_map
        mesh = make_mesh(label_map, config.mesh, out=out / "mesh").mesh
    settings = replace(config.simulation, workers=workers)
    store, _ = make_simulations(mesh, settings, out=out / "simulation", scheduler=scheduler)
    return store


def _prepare(
    table: SampleTable, split: Split, store: SimulationStore, config: AblationConfig, mesh: TissueMesh, *, out: Path,
    scheduler: str | None,
) -> SampleTable:
    """Training samples; they, the validation samples and all test sets are written for the workers, once."""
    seen = seen_in_training(table, config)
    train, validation = (
        table.select(np.isin(table.position_index, part) & seen) for part in (split.train, split.validation)
    )
    for name, samples in (("training", train), ("validation", validation)):
        if not len(samples):
            raise InputError(
                f"{name} samples", expected="at least one", got="none after the hold-outs were taken out",
                fix="leave more rotations or depths in",
            )
    if (out / SAMPLES / SETS).exists():
        return train
    sets = own_sets(table, split, config)
    if config.other_probe is not None:
        where = np.array(store.positions)[split.test]
        sets["probe"] = probe_set(
            mesh, settings_of(store), config, config.other_probe, where, out=out / "other-probe-simulation",
            scheduler=scheduler,
        )
    split.save(out / "split.json")
    save_record(out / SAMPLES / "counts.json", {"train": len(train), "validation": len(validation)})
    save_sets(out, mesh, sets, train=train, validation=validation)
    return train


def _baselines(store: SimulationStore, mesh: TissueMesh, table: SampleTable, out: Path) -> None:
    """Evaluate on every test set what needs no training."""
    folders: list[tuple[str, Callable[[], object]]] = [
        ("no-motion", lambda: ZeroModel(mesh.n_points)),
        ("elastic-prior", lambda: cached_prior(
            mesh, store.materials(), touched=_contacts(out, table), restraints=store.restraints(),
        )),
    ]
    for name, build in folders:
        missing = [entry for entry in test_set_names(out) if not evaluation_path(out, name, entry).exists()]
        model = build() if missing else None
        for entry in missing:
            evaluate_once(
                model, out, entry, mesh, path=evaluation_path(out, name, entry), notes={"row": name, "seed": None},
            )


def _contacts(out: Path, table: SampleTable) -> IntArray:
    """Contact nodes that the prior must know: the table's, and the other probe's."""
    other = out / SAMPLES / "probe"
    if not (other / "samples.json").exists():
        return table.contact_nodes
    return np.union1d(table.contact_nodes, SampleTable.load(other).contact_nodes)
