"""Tables of the paper's experiments: every row on a test set, the paper's claims, the need for data."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mixpinn.evaluation.paper import PAPER_ABLATION, PAPER_RESULTS, PaperResult
from mixpinn.evaluation.statistics import bootstrap_interval
from mixpinn.evaluation.table import Cell, Table
from mixpinn.evaluation.tables import METRIC_LABELS
from mixpinn.records import Evaluation

ROW_TITLES = {
    "no-motion": "No motion", "elastic-prior": "Elastic prior", "physgnn": "PhysGNN",
    **{f"row-{number}": f"Row {number}" for number in range(1, 14)},
    "row-1": "Row 1 (simple GAT)", "row-10": "Row 10 (MIXPINN)",
}
"""How the rows are called; the first two need no training."""

VIRTUAL_PAIRS = tuple(
    (without, with_virtual, kind)
    for without, nodes, edges in ((2, 10, 11), (3, 5, 6), (4, 7, 8), (9, 12, 13))
    for with_virtual, kind in ((nodes, "VN"), (edges, "VE"))
)
"""Rows that differ by virtual nodes (VN) or virtual edges (VE) alone: without, with, which."""

REL_PAIRS = ((2, 9), (3, 4), (5, 7), (6, 8), (10, 12), (11, 13))
"""Rows that differ by the Rigid Edge Loss alone: without, with."""


@dataclass(frozen=True, eq=False)
class AblationRun:
    """One row with one seed, tested.

    Attributes:
        row: key of `ROW_TITLES`.
        seed: of its training; None where nothing is trained.
        positions: number of training positions where it is not all; such runs are the data-need curve.
        evaluations: by name of the test set.
        training: epochs, seconds and losses, for the reader.
    """

    row: str
    seed: int | None
    positions: int | None
    evaluations: Mapping[str, Evaluation]
    training: Mapping[str, Any] = field(default_factory=dict)

    def mean(self, test_set: str, metric: str) -> float | None:
        """Mean of a metric over the samples of a test set; None where it is not known."""
        values = self.evaluations[test_set].metrics.get(metric) if test_set in self.evaluations else None
        return None if values is None else float(values.mean())


def by_row(runs: Sequence[AblationRun]) -> dict[str, list[AblationRun]]:
    """Runs with all training positions by row, in the order of `ROW_TITLES`."""
    found: dict[str, list[AblationRun]] = {}
    for row in ROW_TITLES:
        members = [run for run in runs if run.row == row and run.positions is None]
        if members:
            found[row] = members
    return found


def over_seeds(runs: Sequence[AblationRun], test_set: str, metric: str) -> tuple[float, float | None] | None:
    """Mean over the seeds of the means over samples, and their standard deviation (divisor k − 1) where k > 1."""
    values = [value for run in runs if (value := run.mean(test_set, metric)) is not None]
    if not values:
        return None
    return float(np.mean(values)), float(np.std(values, ddof=1)) if len(values) > 1 else None


def test_set_table(runs: Sequence[AblationRun], test_set: str, *, title: str, note: str, seed: int) -> Table:
    """Every row on one test set: the paper's six metrics, the spread over seeds, and the interval over positions."""
    rows: list[tuple[Cell, ...]] = []
    for row, members in by_row(runs).items():
        figures = {metric: over_seeds(members, test_set, metric) for metric in METRIC_LABELS}
        if figures["mee"] is None:
            continue
        values = np.mean([run.evaluations[test_set].metrics["mee"] for run in members], axis=0)
        low, high = bootstrap_interval(
            values, members[0].evaluations[test_set].about["position"], generator=np.random.default_rng(seed),
        )
        rows.append((
            ROW_TITLES[row], switches(row), len([run for run in members if run.seed is not None]) or None,
            *(None if figure is None else figure[0] for figure in figures.values()),
            figures["mee"][1], figures["rigid_mee"][1] if figures["rigid_mee"] else None, low, high,
        ))
    columns = (
        "Model", "Switches", "Seeds", *METRIC_LABELS.values(), "± MEE", "± rigid MEE", "MEE 95 % low",
        "MEE 95 % high",
    )
    return Table(title, columns, tuple(rows), note)


def switches(row: str) -> str:
    """Heads and switches of a row in the words of the paper's table."""
    found = [entry for entry in PAPER_ABLATION if f"row-{entry.experiment}" == row]
    if not found:
        return ""
    entry = found[0]
    named = {
        "edge": entry.edge_features, "REL": entry.rigid_edge_loss, "VN": entry.virtual_nodes,
        "VE": entry.virtual_edges,
    }
    heads = "1 head" if entry.heads == 1 else f"{entry.heads} heads"
    return ", ".join([heads, *(name for name, on in named.items() if on)])


def paper_table(runs: Sequence[AblationRun], test_set: str) -> Table:
    """Ours beside the paper's, row by row: MEE, rigid MEE and REE, and each relative to row 1."""
    rows: list[tuple[Cell, ...]] = []
    members = by_row(runs)
    quoted: dict[str, PaperResult] = {f"row-{entry.experiment}": entry.result for entry in PAPER_ABLATION}
    quoted["physgnn"] = PAPER_RESULTS[0]
    basis = over_seeds(members.get("row-1", []), test_set, "mee")
    for row, title in ROW_TITLES.items():
        if row not in members and row not in quoted:
            continue
        ours = [over_seeds(members.get(row, []), test_set, metric) for metric in ("mee", "rigid_mee", "ree")]
        paper = quoted.get(row)
        theirs: tuple[Cell, ...] = (None,) * 4
        if paper is not None:
            theirs = (paper.mee, paper.rigid_mee, paper.ree, paper.mee / quoted["row-1"].mee)
        relative = ours[0][0] / basis[0] if ours[0] and basis else None
        rows.append((title, switches(row), *(None if item is None else item[0] for item in ours), relative, *theirs))
    columns = (
        "Model", "Switches", "MEE [mm]", "Rigid MEE [mm]", "REE [mm]", "MEE / row 1", "MEE (paper)",
        "Rigid MEE (paper)", "REE (paper)", "MEE / row 1 (paper)",
    )
    note = "The paper's figures count virtual nodes and edges, and belong to its own mesh, fields, width and budget."
    return Table("Ours beside the paper's", columns, tuple(rows), note)


def claims_table(runs: Sequence[AblationRun], test_set: str) -> Table:
    """The paper's claims as ratios: what virtual nodes, virtual edges and the Rigid Edge Loss change; who is last.

    Two rows are compared over the seeds that both were trained with.
    """
    members = by_row(runs)
    paper = {entry.experiment: entry.result for entry in PAPER_ABLATION}

    def compared(without: int, with_it: int, metric: str) -> tuple[float, float, int] | None:
        pair = [{run.seed: run for run in members.get(f"row-{number}", [])} for number in (without, with_it)]
        seeds = [seed for seed in pair[0] if seed in pair[1]]
        a, b = (over_seeds([row[seed] for seed in seeds], test_set, metric) for row in pair)
        return None if a is None or b is None else (a[0], b[0], len(seeds))

    rows: list[tuple[Cell, ...]] = []
    for without, with_virtual, kind in VIRTUAL_PAIRS:
        found = compared(without, with_virtual, "rigid_mee")
        if found is not None:
            a, b, count = found
            rows.append((
                f"{kind} lowers rigid MEE", f"{without} → {with_virtual}", a, b, a / b,
                paper[without].rigid_mee / paper[with_virtual].rigid_mee, "yes" if a / b >= 1.5 else "no", count,
            ))
    for without, with_rel in REL_PAIRS:
        found = compared(without, with_rel, "ree")
        if found is not None:
            a, b, count = found
            rows.append((
                "REL lowers REE", f"{without} → {with_rel}", a, b, a / b, paper[without].ree / paper[with_rel].ree,
                "yes" if b < a else "no", count,
            ))
    physgnn = over_seeds(members.get("physgnn", []), test_set, "mee")
    others = {row: over_seeds(runs, test_set, "mee") for row, runs in members.items() if row.startswith("row-")}
    known = {row: figure[0] for row, figure in others.items() if figure is not None}
    if physgnn is not None and known:
        worst = max(known, key=lambda row: known[row])
        rows.append((
            "PhysGNN is last", f"PhysGNN against {ROW_TITLES[worst]}", physgnn[0], known[worst],
            physgnn[0] / known[worst], PAPER_RESULTS[0].mee / max(entry.result.mee for entry in PAPER_ABLATION),
            "yes" if physgnn[0] > known[worst] else "no", len(members["physgnn"]),
        ))
    columns = ("Claim", "Rows", "Without [mm]", "With [mm]", "Ratio", "Ratio (paper)", "Shown", "Seeds")
    note = (
        "Rows are compared over the seeds that both were trained with. VN and VE count as shown from a ratio of 1.5 "
        "on. In the last line the two figures are the MEE of PhysGNN and of the worst row of the ablation."
    )
    return Table("The paper's claims", columns, tuple(rows), note)


def hold_out_table(runs: Sequence[AblationRun], test_sets: Sequence[str], *, metric: str = "mee") -> Table:
    """One metric of every row on every test set, mean over seeds."""
    rows: list[tuple[Cell, ...]] = []
    for row, members in by_row(runs).items():
        figures = [over_seeds(members, name, metric) for name in test_sets]
        rows.append((ROW_TITLES[row], switches(row), *(None if figure is None else figure[0] for figure in figures)))
    label = METRIC_LABELS[metric]
    return Table(f"{label} on every test set", ("Model", "Switches", *test_sets), tuple(rows), "Mean over seeds.")


def data_need_table(runs: Sequence[AblationRun], test_set: str, *, all_positions: int) -> Table | None:
    """Error against the number of training positions; None where no such run was asked for."""
    few = sorted((run for run in runs if run.positions is not None), key=lambda run: run.positions or 0)
    if not few:
        return None
    whole = [
        run for run in runs if run.row == few[0].row and run.positions is None and run.seed == few[0].seed
    ]
    rows: list[tuple[Cell, ...]] = [
        (
            all_positions if run.positions is None else run.positions, run.training.get("samples"),
            run.training.get("epochs"), *(run.mean(test_set, metric) for metric in METRIC_LABELS),
        )
        for run in (*few, *whole)
    ]
    columns = ("Training positions", "Samples", "Epochs", *METRIC_LABELS.values())
    note = f"{ROW_TITLES[few[0].row]}, one seed, the same number of sample passes for each, positions nested."
    return Table("Need for data", columns, tuple(rows), note)


def budget_table(runs: Sequence[AblationRun]) -> Table:
    """What each run was given: epochs, samples, time and how it ended."""
    rows: list[tuple[Cell, ...]] = [
        (
            ROW_TITLES[run.row], run.seed, run.positions, *(
                run.training.get(key) for key in (
                    "samples", "epochs", "best_epoch", "best_validation_loss", "seconds", "stopped_by",
                )
            ),
        )
        for run in runs if run.seed is not None
    ]
    columns = (
        "Model", "Seed", "Positions", "Samples", "Epochs", "Best epoch", "Validation loss [mm]", "Seconds", "Ended by",
    )
    return Table("Budget of each run", columns, tuple(rows), "Positions: a dash means all training positions.")
