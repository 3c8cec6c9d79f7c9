"""The end of the table: metrics of all runs in, tables and pictures out."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from mixpinn.base.files import write_json, write_text
from mixpinn.base.progress import console
from mixpinn.base.rundir import versions
from mixpinn.base.validated import load_record
from mixpinn.dataset import Split
from mixpinn.evaluation import Table, save_figure
from mixpinn.graph import part_diameters, rigid_reach
from mixpinn.networks import MIXPINN, read_description
from mixpinn.records import Evaluation, SampleTable, TissueMesh
from mixpinn.records.answer import discretisation_of
from mixpinn.studies.ablation_config import AblationConfig
from mixpinn.studies.ablation_jobs import (
    MODELS_FOLDER,
    REMAKE,
    SAMPLES,
    AblationJob,
    evaluation_path,
    test_set_names,
)
from mixpinn.studies.ablation_plots import ablation_bars, data_need_curve, hold_out_bars
from mixpinn.studies.ablation_sets import TestSet, load_sets
from mixpinn.studies.ablation_tables import (
    AblationRun,
    budget_table,
    claims_table,
    data_need_table,
    hold_out_table,
    paper_table,
    test_set_table,
)

RESULTS = "results"
SHOWN_ROWS = ("no-motion", "elastic-prior", "physgnn", "row-1", "row-10", "row-11")
"""Rows in the picture of the hold-outs."""


def load_runs(folder: Path, jobs: Sequence[AblationJob]) -> tuple[AblationRun, ...]:
    """The untrained baselines and every run of `jobs` that is finished, with their metrics."""
    names = test_set_names(folder)

    def evaluations(model: str) -> dict[str, Evaluation]:
        paths = {name: evaluation_path(folder, model, name) for name in names}
        return {name: Evaluation.load(path) for name, path in paths.items() if path.exists()}

    runs = [AblationRun(row, None, None, evaluations(row)) for row in ("no-motion", "elastic-prior")]
    for job in jobs:
        found = evaluations(job.name)
        if found:
            training: Mapping[str, Any] = read_description(folder / MODELS_FOLDER / job.name)["training"]
            few = None if job.positions is None else len(job.positions)
            runs.append(AblationRun(job.row, job.seed, few, found, training))
    return tuple(run for run in runs if run.evaluations)


def make_tables(
    runs: Sequence[AblationRun], sets: Sequence[TestSet], config: AblationConfig, *, train_positions: int,
) -> list[Table]:
    """All tables: each test set, claims, the paper's figures, hold-outs at a glance, need for data, budgets."""
    names = [entry.name for entry in sets]
    note = (
        "Mean over seeds of the mean over samples; ± is the standard deviation over seeds; the 95 % interval is by "
        "bootstrap over probe positions."
    )
    tables = [
        test_set_table(
            runs, entry.name, title=f"Test set “{entry.name}”", seed=config.split.seed,
            note=f"What is new: {entry.description}. {entry.positions} positions, {entry.poses} poses, "
            f"{entry.samples} samples. {note}",
        )
        for entry in sets
    ]
    tables += [hold_out_table(runs, names), hold_out_table(runs, names, metric="rigid_mee")]
    need = data_need_table(runs, "test", all_positions=train_positions)
    tables += [claims_table(runs, "test"), paper_table(runs, "test"), *([need] if need else []), budget_table(runs)]
    return tables


def write_ablation_report(
    folder: Path, jobs: Sequence[AblationJob], config: AblationConfig, mesh: TissueMesh,
) -> Path:
    """Write ``results.json``, ``results.csv``, ``results.md`` and the pictures of the finished runs.

    Args:
        folder: of the table.
        jobs: the runs.
        config: of the table.
        mesh: of the samples.

    Returns:
        Path of ``results.md``.
    """
    sets, runs = load_sets(folder), load_runs(folder, jobs)
    split = Split.load(folder / "split.json")
    counts = load_record(dict[str, int], folder / SAMPLES / "counts.json", remake=REMAKE)
    diameters = part_diameters(mesh)
    reach = rigid_reach(mesh, SampleTable.load(folder / SAMPLES / "test"), config.layers)
    protocol = protocol_line(
        config, diameters=diameters, reach=reach, mesh=mesh, split=split, counts=counts,
    )
    tables = make_tables(runs, sets, config, train_positions=len(split.train))
    names = [entry.name for entry in sets]
    pictures = {}
    if config.pictures:
        pictures["rows.png"] = ablation_bars(runs, "test")
        pictures["hold-outs.png"] = hold_out_bars(runs, names, rows=SHOWN_ROWS)
        if any(run.positions is not None for run in runs):
            pictures["data-need.png"] = data_need_curve(runs, "test", all_positions=len(split.train))
        for name, figure in pictures.items():
            save_figure(figure, folder / name)
    write_json(folder / f"{RESULTS}.json", {
        "protocol": protocol, "diameters": diameters, "reach": reach, "nodes": mesh.n_points, "counts": counts,
        "positions": {name: len(part) for name, part in split.parts.items()},
        "test_sets": [asdict(entry) for entry in sets],
        "runs": [_plain(run) for run in runs],
        "tables": [
            {"title": table.title, "columns": table.columns, "rows": table.rows, "note": table.note}
            for table in tables
        ],
        "versions": versions(),
    })
    write_text(folder / f"{RESULTS}.csv", tables[0].csv())
    shown = [f"![{name.removesuffix('.png')}]({name})\n" for name in pictures]
    write_text(folder / f"{RESULTS}.md", "\n".join([
        "## The paper's experiments\n", protocol + "\n", *shown, *(table.markdown() for table in tables),
    ]))
    console.print(hold_out_table(runs, names).rich())
    return folder / f"{RESULTS}.md"


def protocol_line(
    config: AblationConfig, *, diameters: Mapping[str, int], reach: float, mesh: TissueMesh, split: Split,
    counts: Mapping[str, int],
) -> str:
    """What a reader must know beside every figure, in a few sentences."""
    across = ", ".join(f"{name.removeprefix('vertebrae_')} {hops}" for name, hops in diameters.items())
    parts = " / ".join(str(len(part)) for part in split.parts.values())
    budget = (
        f"{config.passes:,} sample passes (whole epochs)" if config.passes is not None
        else f"at most {config.train.max_epochs} epochs, early stop after {config.train.stop_patience} without "
        "improvement"
    )
    train = config.train.for_model(MIXPINN)
    repeated = ", ".join(row for row in config.repeated if row in config.models)
    every, first = ", ".join(map(str, config.seeds)), config.seeds[0]
    seeds = f"Seeds {every} for {repeated}; {first} for the others." if repeated else f"Seed {first} for all."
    return (
        f"Mesh of {mesh.n_points:,} nodes ({discretisation_of(mesh)}); edges from one end of a rigid part to the "
        f"other: {across}; {100.0 * reach:.0f} % of the rigid nodes lie within {config.layers} edges of a contact "
        f"node. Positions {parts} (train / validation / test); {counts['train']:,} training and "
        f"{counts['validation']:,} validation samples. {config.layers} layers of width "
        f"{config.hidden} a head (PhysGNN {config.physgnn_hidden}), scaling “{config.scaling.value}”, "
        f"AdamW, learning rate {train.learning_rate:g}, batch {train.batch_size} (PhysGNN "
        f"{config.physgnn_learning_rate:g}, {config.physgnn_batch_size}), {budget}. {seeds} "
        f"Contact nodes: {config.split.contact_rule}."
    )


def _plain(run: AblationRun) -> dict[str, Any]:
    return {
        "row": run.row, "seed": run.seed, "positions": run.positions, "training": dict(run.training),
        "means": {
            name: {metric: float(values.mean()) for metric, values in evaluation.metrics.items()}
            for name, evaluation in run.evaluations.items()
        },
        "milliseconds": {
            name: float(evaluation.seconds.mean() * 1e3) for name, evaluation in run.evaluations.items()
        },
    }
