"""Section of the benchmarks' figures: the JSON object that each prints as its last line."""

import json
from pathlib import Path

from benchmarks.results.section import Data, Section, table


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


SPEED = Section("speed", collect, render, metavar="NAME=FILE", help="output of a benchmark; repeatable", several=True)
