"""Section of the hybrid model: bars, what was tried, data need, hold-outs, error estimate, recordings, pose alone."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from benchmarks.results.section import OWN_SOLVER, Data, Section
from mixpinn.base.files import atomic_path, read_json

PARTS = ("bars", "variants", "network", "data", "hold-outs", "error", "sofa", "pose")
PAPER_MIXPINN = {"mee": 0.2588, "rigid_mee": 0.1663, "soft_mee": 0.3126, "ree": 0.0326, "milliseconds": 73.24}
"""The paper's own figures, from its own simulations, with contact nodes *listed*: not the same samples."""
PICTURE = "hybrid-data.png"
_BESIDE = ("mee", "rigid_mee", "soft_mee", "ree", "mee_p95", "mee_max")
"""Figures of the bars that stand in the table of models too."""


def collect(run: Path, images: Path) -> Data:
    """The parts that lie in a folder, and a plot of the data need."""
    found = {part: read_json(run / f"{part}.json") for part in PARTS if (run / f"{part}.json").exists()}
    if "data" in found:
        _draw(found["data"], images / PICTURE)
    return found


def _draw(rows: Sequence[Mapping[str, Any]], path: Path) -> None:
    figure = Figure(figsize=(6.0, 3.6), layout="constrained")
    axes = figure.subplots()
    for index, name in enumerate(dict.fromkeys(row["model"] for row in rows)):
        mine = [row for row in rows if row["model"] == name]
        axes.loglog([r["positions"] for r in mine], [r["mee"] for r in mine], "o-", color=f"C{index}", label=name)
    counts = sorted({row["positions"] for row in rows})
    axes.set_xticks(counts, [str(count) for count in counts])
    axes.minorticks_off()
    axes.set_yticks([0.005, 0.01, 0.02, 0.05, 0.1], ["0.005", "0.01", "0.02", "0.05", "0.1"])
    axes.set(xlabel="training positions", ylabel="MEE at test positions [mm]")
    axes.legend(frameon=False)
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=150, format="png")


def _table(columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    def cell(value: Any) -> str:
        if not isinstance(value, float):
            return str(value)
        return f"{value:.2g}" if 0.0 < abs(value) < 1e-3 else f"{value:.4f}"

    lines = [f"| {' | '.join(columns)} |", "| --- |" + " ---: |" * (len(columns) - 1)]
    return "\n".join([*lines, *(f"| {' | '.join(cell(value) for value in row)} |" for row in rows)]) + "\n"


_ERRORS = {
    "mee": "MEE [mm]", "rigid_mee": "Rigid MEE [mm]", "soft_mee": "Soft MEE [mm]", "ree": "REE [mm]",
    "mee_p95": "95th percentile", "mee_max": "Worst",
}


def _errors(rows: Sequence[Mapping[str, Any]], *extra: str) -> str:
    columns = [*(name.replace("_", " ").capitalize() for name in extra), "Model", *_ERRORS.values()]
    return _table(columns, [
        [*(row[name] for name in extra), row["model"], *(row.get(name, "–") for name in _ERRORS)] for row in rows
    ])


def render(data: Data) -> str:
    """The section."""
    lines = ["## The elastic prior with a learned correction\n"]
    if "bars" in data:
        lines += _bars(data["bars"])
    if "variants" in data:
        paper = {"model": "*MIXPINN, the paper's own samples*", **PAPER_MIXPINN}
        rows = [*data["variants"], *data.get("network", []), paper]
        lines += [
            "### What was tried\n",
            "Command: `python -m benchmarks.hybrid_study STORE --split split.json --out DIR`; the network by "
            "`python -m benchmarks.hybrid_network`. The paper's mesh and protocol, contact nodes *loaded*, 93 training "
            "positions, "
            f"{data['variants'][0]['samples']:,} samples at 13 test positions against this project's own "
            "solver.\n", _errors(rows), *_network(data),
        ]
    if "data" in data:
        lines += [
            "### Data need\n", _errors(data["data"], "positions"),
            f"![Error against training positions](images/{PICTURE})\n",
        ]
    if "hold-outs" in data:
        lines += [
            "### What the model has not seen\n",
            "At the 39 validation and test positions, which no fit has seen: a rotation of 135°, depths beyond 15 mm "
            "(both left out of the fit), and a probe with a face of 30 × 10 mm (13 test positions, two rotations).\n",
            _errors(data["hold-outs"], "hold_out", "poses"),
        ]
    if "error" in data:
        lines += _error(data["error"])
    if "sofa" in data:
        lines += [
            "### On SOFA's recordings\n",
            "13 test positions of the recordings, contact nodes *loaded*. Fitted on the recordings of the other 53 "
            "positions, and on our simulations alone, without those at the 13 positions.\n", _errors(data["sofa"]),
        ]
    if "pose" in data:
        lines += _pose(data["pose"])
    return "\n".join(lines)


def brief(data: Data) -> str:
    """The section in short: the bars that the table of models does not show, and that table."""
    bars = _bars(data["bars"], without=_BESIDE)
    return "\n".join(["## The elastic prior with a learned correction\n", *bars, short(data) + "\n"])


def short(data: Data) -> str:
    """The README's few figures of the hybrid model."""
    bars, cores = data["bars"], data["machine"].rpartition(", ")[2]
    shown = ("No motion", "Elastic prior", "Prior + quadratic ridge", "Hybrid")
    rows = [row for row in data["variants"] if row["model"] in shown]
    paper = {"model": "*MIXPINN, the paper's own samples*", **PAPER_MIXPINN}
    return "\n".join([
        f"{bars['samples']:,} samples at 13 positions that no model has seen, contact displacement in, all "
        f"{bars['nodes']:,} displacements out; the hybrid model takes {bars['latency_ms_p50']:.1f} ms a prediction "
        f"(median, {cores}), and {bars['pose_latency_ms_p50']:.1f} ms from the probe's pose alone (MEE "
        f"{bars['pose_mee']:.3f} mm):\n",
        _errors([*rows, paper]),
    ]).rstrip()


def _bars(bars: Mapping[str, Any], *, without: Sequence[str] = ()) -> list[str]:
    rows = [
        ("MEE [mm]", "mee", "≤ 0.015"), ("Rigid MEE [mm]", "rigid_mee", "≤ 0.015"),
        ("Soft MEE [mm]", "soft_mee", "≤ 0.015"),
        ("REE [mm]", "ree", "≤ 1e-5"), ("95th percentile of MEE [mm]", "mee_p95", "≤ 0.06"),
        ("Worst sample's MEE [mm]", "mee_max", "≤ 0.2"), ("Median latency [ms]", "latency_ms_p50", "≤ 5"),
        ("99th percentile of latency [ms]", "latency_ms_p99", "≤ 10"), ("Loading [s]", "loading_seconds", "≤ 1"),
        ("MEE from the pose alone [mm]", "pose_mee", "≤ 0.1"),
        ("Median latency from the pose [ms]", "pose_latency_ms_p50", "≤ 10"),
        ("Error of a vertebra's translation from the pose, 95th percentile [mm]", "vertebra_translation_p95", "≤ 0.1"),
        ("Error of a vertebra's rotation from the pose, 95th percentile [°]", "vertebra_rotation_p95_deg", "≤ 0.05"),
        ("Relative error of the probe's force from the pose, mean", "force_error_mean", "≤ 0.1"),
        ("Relative error of the probe's force from the pose, 95th percentile", "force_error_p95", "≤ 0.1"),
    ]
    return [
        f"Command: `python -m benchmarks.hybrid BUNDLE --threads {bars['threads']}`; {bars['samples']:,} test samples, "
        f"{bars['nodes']:,} nodes. Contact displacement in, field of all displacements out, one sample at a time.\n",
        _table(("Figure", "Measured", "Aim"), [
            (name, bars[key], aim) for name, key, aim in rows if key in bars and key not in without
        ]),
    ]


def _network(data: Data) -> list[str]:
    if "network" not in data:
        return []
    row = data["network"][0]
    return [
        f"The network on top of the prior learned from {row['training_samples']:,} samples in {row['epochs']} epochs "
        f"and {row['seconds'] / 60:.0f} minutes on one core; the hybrid model's fit takes less than two. Its rigid "
        "parts are free to stretch.\n",
    ]


def _error(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    whole, folds = rows[0], rows[1:]
    return [
        "### How far the error is known\n",
        f"Cross-fitted over the {len(folds)} quarters of the validation and test positions: the estimate ranks errors "
        f"with Spearman's ρ = {whole['spearman']:.2f} over all {whole['samples']:,} samples and "
        f"{whole['spearman_fixed_depth']:.2f} at fixed depth (mean over depths; the least is "
        f"{whole['spearman_fixed_depth_least']:.2f}). It costs "
        f"{whole['milliseconds']:.1f} ms beside the prediction.\n",
        _table(
            ("Positions", "Samples", "Errors below their 95 % bound", "Median of bound / error", "Flagged as outside"),
            [
                (f"quarter {r['fold'] + 1}", r["samples"], r["coverage"], r["bound_over_error"], r["outside"])
                for r in folds
            ],
        ),
    ]


def _pose(pose: Mapping[str, Any]) -> list[str]:
    return [
        "### From the pose alone\n",
        "Command: `python -m benchmarks.pose STORE`. Contact is solved on the prior's compliance; the reference is the "
        "full contact simulation at that pose.\n",
        _table(
            ("Figure", "Measured"),
            [(key.replace("_", " "), value) for key, value in pose.items() if value is not None],
        ),
    ]


HYBRID = Section(
    "hybrid", collect, render, brief=brief, kind=OWN_SOLVER,
    help="folder of benchmarks.hybrid_study and its companions",
)
