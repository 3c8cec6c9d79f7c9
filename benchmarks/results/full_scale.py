"""Section of the paper's widths on the paper's mesh: networks trained and tested on recordings of SOFA."""

from collections.abc import Sequence
from dataclasses import astuple
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.results.section import SOFA, Data, Section, table
from mixpinn.base.files import read_json
from mixpinn.evaluation import PAPER_RESULTS, depth_table, loss_curves, results_table, save_figure, spread_table
from mixpinn.records import Evaluation
from mixpinn.training import read_history
from mixpinn.training.history import HISTORY_FILE

RESULTS = Path(__file__).parents[2] / "docs" / "results"
PICTURE = "full-scale-loss.png"
RIDGE = "Prior + quadratic ridge, SOFA"
REFERENCE: dict[str, tuple[float | None, ...]] = {
    "Prior": (0.0333, None, None, None, None, None, None, None),
    "Prior + quadratic ridge": (0.0167, None, None, 0.0162, None, None, 0.044, 0.066),
}
"""Reference values of the comparison's protocol at these test positions, by another implementation."""


def collect(entries: Sequence[str], images: Path) -> Data:
    """The run directory of ``mixpinn evaluate``, and after it those of the trainings that it tested."""
    run, *trainings = (Path(entry) for entry in entries)
    evaluations = [Evaluation.load(path) for path in sorted(run.glob("evaluation-*.json"))]
    save_figure(loss_curves({folder.name: folder / HISTORY_FILE for folder in trainings}), images / PICTURE)
    compared = results_table(evaluations, with_paper=False)
    errors = [evaluation.metrics["mee"] for evaluation in evaluations]
    hybrid = read_json(RESULTS / "hybrid.json") if (RESULTS / "hybrid.json").exists() else {}
    return {
        "run": read_json(run / "run.json")["started"][:10], "samples": len(errors[0]),
        "positions": len(np.unique(evaluations[0].about["position"])),
        "models": [
            [*row, float(np.quantile(mee, 0.95)), float(mee.max())] for row, mee in zip(
                compared.rows, errors, strict=True,
            )
        ],
        "columns": [*compared.columns, "95th percentile", "Worst"],
        # The same samples, by another command.
        "ridge": [row for row in hybrid.get("sofa", []) if row["model"] == RIDGE],
        "tables": [
            made.markdown() for made in (
                results_table(evaluations, as_published=True), depth_table(evaluations),
                spread_table(evaluations, generator=np.random.default_rng(0)),
            )
        ],
        "trainings": [_training(folder) for folder in trainings],
    }


def _training(folder: Path) -> dict[str, Any]:
    history, run = read_history(folder), read_json(folder / "run.json")
    best = min(history, key=lambda record: record.validation_loss)
    train = run["config"]["training"]
    return {
        "name": folder.name, "epochs": len(history), "best_epoch": best.epoch, "validation_loss": best.validation_loss,
        "train_loss": best.train_loss, "minutes": sum(record.seconds for record in history) / 60.0,
        "learning_rate": train["learning_rate"], "batch_size": train["batch_size"],
    }


def render(data: Data) -> str:
    """The section."""
    columns = (
        "Run", "Epochs", "Best epoch", "Training loss [mm]", "Validation loss [mm]", "Minutes", "Learning rate",
        "Batch",
    )
    trainings = [
        (entry["name"], entry["epochs"], entry["best_epoch"], f"{entry['train_loss']:.4f}",
         f"{entry['validation_loss']:.4f}", f"{entry['minutes']:.0f}", entry["learning_rate"], entry["batch_size"])
        for entry in data["trainings"]
    ]
    return "\n".join([
        brief(data),
        "### Budget of each training\n", table(columns, trainings),
        "One thread each; other work shared the cores.\n",
        f"![Loss of each epoch](images/{PICTURE})\n", *data["tables"],
    ])


def brief(data: Data) -> str:
    """The section in short: the models beside each other."""
    def cells(row: Sequence[Any]) -> list[str]:
        return ["–" if value is None else value if isinstance(value, str) else f"{value:.4f}" for value in row]

    rows = [cells(row) for row in data["models"]]
    rows += [
        cells([row["model"], row["mee"], None, None, row["rigid_mee"], row["soft_mee"], row["ree"], row["mee_p95"],
               row["mee_max"]]) for row in data["ridge"]
    ]
    rows += [cells([f"*{name}, reference value*", *figures]) for name, figures in REFERENCE.items()]
    for quoted in PAPER_RESULTS:
        model, *figures = astuple(quoted)
        rows.append(cells([f"*{model}, the paper's own samples*", *figures, None, None]))
    return "\n".join([
        "## At the paper's width, on recordings of SOFA\n",
        "Commands: `mixpinn import sofa RECORDINGS --mesh MESH --paper-constants`, `mixpinn train STORE --split "
        "every-fifth --model row-1 --width authors --scaling standard --epochs 10 --set train.learning_rate=1e-3` "
        "(and `row-10`), `mixpinn evaluate STORE ROW-1 ROW-10 --split every-fifth`. "
        f"Run of {data['run']} on {data['machine']}. The paper's mesh of 8,746 nodes, contact nodes *loaded*; 53 "
        f"positions to learn from, of which 9 validate; {data['samples']} samples at {data['positions']} test "
        "positions.\n",
        table(data["columns"], rows),
        *_ratio(data),
        "The networks were given the same number of epochs, a small part of the paper's budget, and learn from about "
        "half of its positions; the paper's rows are of other samples and count virtual nodes and edges (in the full "
        "tables, ours *as published* do so too). The ridge regression is that of `python -m "
        "benchmarks.hybrid_study`, on the same test samples.\n",
    ])


def _ratio(data: Data) -> list[str]:
    """What the claim about virtual nodes comes to, where both networks are there."""
    rigid = {row[0]: row[data["columns"].index("Rigid MEE [mm]")] for row in data["models"]}
    if not {"Simple GAT", "MIXPINN"} <= rigid.keys():
        return []
    return [
        "MIXPINN, with virtual nodes and a second head, has a rigid MEE "
        f"{rigid['Simple GAT'] / rigid['MIXPINN']:.2f} times lower than the simple GAT.\n",
    ]


FULL_SCALE = Section(
    "full-scale", collect, render, brief=brief, kind=SOFA, several=True,
    help="run directory of 'mixpinn evaluate'; given again, those of the trainings that it tested",
)
