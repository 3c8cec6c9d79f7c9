"""Section of the benchmarks' figures: the JSON object that each prints as its last line."""

import json
from pathlib import Path

from benchmarks.results.section import Data, Section, table

SHOWN = (
    "seconds_per_step", "iterations_per_step", "factorizations_per_step", "inference_fused_ms", "inference_ratio",
    "training_ratio", "memory_ratio", "threads",
)
"""Figures that the page of results shows of a benchmark that has them."""


def collect(entries: list[str], images: Path) -> Data:
    """Figures from ``NAME=FILE`` entries, the file's last line being what ``python -m benchmarks.NAME`` printed."""
    figures = {}
    for entry in entries:
        name, _, path = entry.partition("=")
        figures[name] = json.loads(Path(path).read_text().strip().splitlines()[-1])
    return {"benchmarks": figures}


def render(data: Data) -> str:
    """The section."""
    lines = ["## Speed\n"]
    for name, values in data["benchmarks"].items():
        rows = [
            (key, f"{value:.4g}" if isinstance(value, float) else value)
            for key, value in values.items() if not isinstance(value, dict | list)
        ]
        lines += [f"### `python -m benchmarks.{name}`\n", table(("Figure", "Value"), rows)]
    return "\n".join(lines)


def brief(data: Data) -> str:
    """The section in short: one line a benchmark."""
    rows = [
        (f"`python -m benchmarks.{name}`", "; ".join(
            f"{key.replace('_', ' ')} {values[key]:.4g}" for key in SHOWN if isinstance(values.get(key), int | float)
        )) for name, values in data["benchmarks"].items()
    ]
    return "## Speed\n\n" + table(("Command", "Figures"), rows, numeric_from=2)


SPEED = Section(
    "speed", collect, render, brief=brief, metavar="NAME=FILE", help="output of a benchmark; repeatable", several=True,
)
