"""The tables of an evaluation, the paper's figures beside the measured ones."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from mixpinn.base.errors import InputError
from mixpinn.evaluation.metrics import AS_PUBLISHED, SOFT, part_label
from mixpinn.evaluation.paper import (
    PAPER_ABLATION,
    PAPER_DATASET,
    PAPER_MESH,
    PAPER_RESULTS,
    PAPER_RUNTIME,
    PaperResult,
)
from mixpinn.evaluation.statistics import depth_profile, summarise_metrics
from mixpinn.evaluation.table import Cell, Table
from mixpinn.mesh import mesh_statistics
from mixpinn.records import Evaluation, TissueMesh

if TYPE_CHECKING:
    from mixpinn.dataset import DatasetTable

METRIC_LABELS = {
    "mee": "MEE [mm]", "mae": "MAE [mm]", "mse": "MSE [mm²]", "rigid_mee": "Rigid MEE [mm]",
    "soft_mee": "Soft MEE [mm]", "ree": "REE [mm]",
}
"""The paper's columns, in its order."""


def results_table(evaluations: Sequence[Evaluation], *, with_paper: bool = True, as_published: bool = False) -> Table:
    """Mean of the paper's six metrics for each model, the paper's rows below.

    Args:
        evaluations: one a model, on the same samples.
        with_paper: append the paper's rows, muted.
        as_published: count virtual nodes and edges as the paper's figures do; models without them stay as they are.

    Raises:
        InputError: evaluations on several discretisations.
    """
    rows: list[tuple[Cell, ...]] = []
    for evaluation in evaluations:
        row: list[Cell] = [evaluation.model]
        for name in METRIC_LABELS:
            values = evaluation.metrics.get(name)
            if as_published:
                values = evaluation.metrics.get(name + AS_PUBLISHED, values)
            row.append(None if values is None else float(values.mean()))
        rows.append(tuple(row))
    measured = len(rows)
    if with_paper:
        rows += [(f"{result.model} (paper)", *_figures(result)) for result in PAPER_RESULTS]
    note = "Mean over samples; MAE and MSE per component; REE over edges inside rigid parts."
    note += _discretisation_note(evaluations)
    if as_published:
        note += " Virtual nodes and edges are counted, as in the paper's figures."
    if with_paper:
        note += " Rows marked (paper) are quoted: other samples, training and machine, so no like-for-like comparison."
    title = "Models compared, as published" if as_published else "Models compared"
    return Table(title, ("Model", *METRIC_LABELS.values()), tuple(rows), note, frozenset(range(measured, len(rows))))


def _discretisation_note(evaluations: Sequence[Evaluation]) -> str:
    """What all errors of a table refer to; nothing where it was not recorded."""
    found = {evaluation.notes["discretisation"]: evaluation.model for evaluation in evaluations
             if evaluation.notes.get("discretisation")}
    if len(found) > 1:
        (first, model), (second, other) = list(found.items())[:2]
        raise InputError(
            "results", expected="evaluations on one discretisation",
            got=f"{model} on {first} and {other} on {second}", fix="make a table for each",
        )
    return "".join(f" All on {name}." for name in found)


def spread_table(evaluations: Sequence[Evaluation], *, generator: np.random.Generator) -> Table:
    """Every metric of every model with its spread: one row a model and metric."""
    rows: list[tuple[Cell, ...]] = []
    for evaluation in evaluations:
        summaries = summarise_metrics(evaluation, generator=generator)
        rows += [
            (evaluation.model, _label(name), *(
                getattr(summaries[name], field) for field in ("mean", "std", "low", "high", "p95", "maximum")
            ))
            for name in (*METRIC_LABELS, *(name + AS_PUBLISHED for name in METRIC_LABELS)) if name in summaries
        ]
    columns = ("Model", "Metric", "Mean", "Std", "95 % low", "95 % high", "95th percentile", "Worst sample")
    note = "Standard deviation over samples; 95 % interval of the mean by bootstrap over probe positions."
    return Table("Spread", columns, tuple(rows), note)


def depth_table(evaluations: Sequence[Evaluation], *, metric: str = "mee") -> Table:
    """Mean of a metric for each millimetre of indentation, one column a model."""
    profiles = [depth_profile(evaluation, metric=metric) for evaluation in evaluations]
    depths = np.unique(np.concatenate([profile.depth for profile in profiles]))
    rows: list[tuple[Cell, ...]] = []
    for depth in depths:
        row: list[Cell] = [int(depth), int(max(profile.count[profile.depth == depth].sum() for profile in profiles))]
        for profile in profiles:
            found = profile.mean[profile.depth == depth]
            row.append(float(found[0]) if len(found) else None)
        rows.append(tuple(row))
    columns = ("Depth [mm]", "Samples", *(evaluation.model for evaluation in evaluations))
    title = f"{METRIC_LABELS.get(metric, metric)} by depth"
    return Table(title, columns, tuple(rows), "Bins of 1 mm, mean over samples.")


def part_table(evaluations: Sequence[Evaluation]) -> Table:
    """MEE of the soft tissue and of each rigid part, one column a model [mm]."""
    names = list(dict.fromkeys(name for evaluation in evaluations for name in evaluation.by_part))
    rows = tuple(
        (part_label(name), *(float(e.by_part[name].mean()) if name in e.by_part else None for e in evaluations))
        for name in names
    )
    return Table("MEE [mm] by part", ("Part", *(e.model for e in evaluations)), rows, "Mean over samples.")


def runtime_table(
    evaluations: Sequence[Evaluation], *, fem_seconds: float | None = None, with_paper: bool = True,
) -> Table:
    """Latency of one prediction for each model, the solver's and the paper's times beside.

    Args:
        evaluations: one a model.
        fem_seconds: mean time of one step of the finite-element solver [s].
        with_paper: append the paper's rows, muted.
    """
    rows: list[tuple[Cell, ...]] = []
    for evaluation in evaluations:
        if len(evaluation.seconds):
            times = evaluation.seconds * 1e3
            threads = evaluation.notes.get("threads")
            rows.append((
                evaluation.model, float(times.mean()), float(np.median(times)), float(np.quantile(times, 0.95)),
                None if threads is None else int(threads),
            ))
    if fem_seconds is not None:
        rows.append(("Finite elements, one step", fem_seconds * 1e3, None, None, None))
    measured = len(rows)
    if with_paper:
        rows += [(f"{name} (paper)", time, None, None, None) for name, time in PAPER_RUNTIME.items()]
    note = "Wall time of one prediction, one sample at a time, warm, from input array to output array."
    columns = ("Method", "Mean [ms]", "Median [ms]", "95th percentile [ms]", "Threads")
    return Table("Time of one prediction", columns, tuple(rows), note, frozenset(range(measured, len(rows))))


def ablation_table(measured: Mapping[int, Evaluation]) -> Table:
    """The paper's 13 configurations with the measured figures, those of the paper beside them.

    Args:
        measured: number of the experiment (1 … 13) to its evaluation; absent ones show a dash.
    """
    rows: list[tuple[Cell, ...]] = []
    for entry in PAPER_ABLATION:
        switches = (entry.edge_features, entry.rigid_edge_loss, entry.virtual_nodes, entry.virtual_edges)
        metrics = measured[entry.experiment].metrics if entry.experiment in measured else {}
        ours = (float(metrics[name].mean()) if name in metrics else None for name in METRIC_LABELS)
        rows.append((
            entry.experiment, entry.heads, *("✓" if switch else "" for switch in switches), *ours,
            entry.result.mee, entry.result.rigid_mee, entry.result.ree,
        ))
    columns = (
        "Experiment", "Heads", "Edge features", "REL", "VN", "VE", *METRIC_LABELS.values(),
        "MEE (paper)", "Rigid MEE (paper)", "REE (paper)",
    )
    return Table("Ablation", columns, tuple(rows), "The paper's figures count virtual nodes and edges.")


def mesh_table(mesh: TissueMesh, *, with_paper: bool = False) -> Table:
    """Points and directed edges of each label; an edge belongs to a rigid part if both its ends do."""
    counts = mesh_statistics(mesh)
    rows: list[tuple[Cell, ...]] = [
        (part_label(part.name if part.label else SOFT), part.points, part.edges) for part in counts.parts
    ]
    rows.append(("Total", counts.points, counts.edges))
    columns: tuple[str, ...] = ("Part", "Points", "Directed edges")
    if with_paper and len(rows) == len(PAPER_MESH):
        rows = [(*row, *quoted[1:]) for row, quoted in zip(rows, PAPER_MESH, strict=True)]
        columns += ("Points (paper)", "Directed edges (paper)")
    note = f"{counts.cells:,} tetrahedra, {counts.fixed:,} fixed nodes."
    return Table("Mesh", columns, tuple(rows), note)


def dataset_counts_table(counts: "DatasetTable", *, with_paper: bool = False) -> Table:
    """Probe positions, poses and samples of each split and in all.

    Args:
        counts: what `mixpinn.dataset.dataset_table` counted.
        with_paper: append the paper's rows, muted.
    """
    columns = (counts.positions, counts.poses, counts.samples)
    rows: list[tuple[Cell, ...]] = list(zip([row[0] for row in PAPER_DATASET], *columns, strict=True))
    measured = len(rows)
    if with_paper:
        rows += [(f"{name} (paper)", *quoted) for name, *quoted in PAPER_DATASET]
    note = f"Split “{counts.split}”, by probe position: all steps and rotations of a position lie in one split."
    muted = frozenset(range(measured, len(rows)))
    return Table("Data set", ("Split", "Positions", "Poses", "Samples"), tuple(rows), note, muted)


def _figures(result: PaperResult) -> tuple[float, ...]:
    return tuple(getattr(result, name) for name in METRIC_LABELS)


def _label(metric: str) -> str:
    label = METRIC_LABELS[metric.removesuffix(AS_PUBLISHED)]
    return f"{label}, as published" if metric.endswith(AS_PUBLISHED) else label
