"""Section of the networks on a GPU: agreement with the CPU, times, and the paper's rows trained at full width."""

import json
from pathlib import Path

from benchmarks.results.section import SOFA, Data, Section, table

DIFFERENCES = ("output", "loss", "gradient")
ERRORS = (("mee", "MEE [mm]"), ("rigid_mee", "Rigid MEE [mm]"), ("soft_mee", "Soft MEE [mm]"), ("ree", "REE [mm]"))


def collect(entries: list[Path | str], images: Path) -> Data:
    """From what ``benchmarks.gpu`` and ``benchmarks.full_width`` printed: the last line of each file."""
    data: Data = {}
    for entry in entries:
        data |= json.loads(Path(entry).read_text(encoding="utf-8").strip().splitlines()[-1])
    return data


def times(data: Data) -> str:
    """Median times as a table."""
    return table(
        ("Network", "Width", "Batch", "Products in", "Inference [ms]", "Training step [ms]", "Memory [GiB]"),
        [(one["model"], one["width"], one["batch"], one["precision"], f"{one['inference_ms']:.1f}",
          f"{one['training_ms']:.1f}", f"{one['gib']:.1f}") for one in data["times"]], numeric_from=2,
    )


def rows(data: Data) -> str:
    """Errors of the trained rows as a table."""
    return table(
        ("Network", "Seed", *(name for _, name in ERRORS), "Best epoch", "Training [s]"),
        [(one["model"], one["seed"], *(f"{one[key]:.4f}" for key, _ in ERRORS), one["best_epoch"],
          f"{one['training_seconds']:.0f}") for one in data["runs"]],
    )


def factors(data: Data) -> str:
    """By what factor virtual nodes and edges lower the rigid error."""
    said = [
        f"{pair.replace(' to ', ' → ')} {one['mean']:.2f}"
        + (f" ({one['least']:.2f} to {one['greatest']:.2f})" if one["seeds"] > 1 else "")
        + f" over {one['seeds']} seed{'s' if one['seeds'] > 1 else ''}" for pair, one in data["gains"].items()
    ]
    return "Rigid MEE is lowered by the factors " + "; ".join(said) + ".\n"


def render(data: Data) -> str:
    """The section."""
    worst = {key: max(one[key] for one in data["agreement"].values()) for key in DIFFERENCES}
    lines = [
        "## On a GPU, at the paper's width\n",
        f"Commands: `python -m benchmarks.gpu STORE --out DIR`, `python -m benchmarks.full_width STORE --out DIR`, on "
        f"{data['device']}; the store is that of `mixpinn import sofa` (8,746 nodes; split `every-fifth`: 53 positions "
        "to learn from, of which 9 validate, 255 samples at 13 test positions). Batch 4, learning rate 1e-3, scaling "
        "“standard”, the same number of epochs for every row.\n",
        f"All {len(data['agreement'])} networks of the paper's tables give the same answers there as on the CPU: "
        f"largest difference of an output {worst['output']:.1e}, of the loss {worst['loss']:.1e}, of a gradient "
        f"{worst['gradient']:.1e}, each relative to the largest value (float32).\n",
        "### Rows 1, 2, 10 and 11 with equal passes\n", rows(data), factors(data),
        "### Time\n", times(data),
        "Row 10 is MIXPINN, rows 2 and 10 have two heads. Four trainings ran side by side.\n",
    ]
    return "\n".join(lines)


def brief(data: Data) -> str:
    """The section in short."""
    lines = render(data).split("### Rows 1")[0] + factors(data)
    mixpinn = next(one for one in data["times"] if (one["model"], one["batch"]) == ("row-10", 1))
    return lines + (
        f"\nMIXPINN takes {mixpinn['inference_ms']:.1f} ms a prediction and {mixpinn['training_ms']:.1f} ms a training "
        f"step there (width “authors”, batch 1, float32).\n"
    )


GPU = Section(
    "gpu", collect, render, brief=brief, kind=SOFA, metavar="FILE", several=True,
    help="output of benchmarks.gpu or of benchmarks.full_width; repeatable",
)
