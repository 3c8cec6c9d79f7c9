"""What earlier runs of the benchmarks took: one line a run, kept in ``benchmarks/history/NAME.jsonl``.

Every benchmark ends in `report`, which adds the line and prints the figures. ``python -m benchmarks.history`` shows the
last runs of each, newest last; a figure that is a time and has grown by more than a fifth against the run before on the
same machine is marked with an exclamation mark. ``MIXPINN_BENCHMARK_HISTORY`` names another folder, and an empty value
keeps nothing.
"""

import argparse
import json
import os
import subprocess
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from benchmarks.machine import machine

ROOT = Path(__file__).parents[1]
FOLDER_VARIABLE = "MIXPINN_BENCHMARK_HISTORY"
SLOWER = 1.2
"""A time that is so many times that of the run before is marked."""


def history_folder() -> Path | None:
    """Where the lines are kept; None where nothing is to be."""
    folder = os.environ.get(FOLDER_VARIABLE, str(Path(__file__).parent / "history"))
    return Path(folder) if folder else None


def report(name: str, figures: Any, *, kept: Mapping[str, Any] | None = None) -> None:
    """Keep the run's line and print `figures` as JSON, the last line of a benchmark.

    Args:
        name: of the benchmark.
        figures: all that it found.
        kept: figures for the history, where `figures` is not a mapping of them.
    """
    folder = history_folder()
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        values = figures if kept is None else kept
        line = {
            "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M"), "commit": commit(), "machine": machine(),
            "figures": {key: value for key, value in values.items() if isinstance(value, int | float | str)},
        }
        with (folder / f"{name}.jsonl").open("a", encoding="utf-8") as file:
            file.write(json.dumps(line, ensure_ascii=False) + "\n")
    print(json.dumps(figures))


def commit() -> str:
    """Short name of the commit that is checked out, with a plus where files differ from it; a dash outside of git."""
    def git(*words: str) -> str:
        return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()

    try:
        return git("rev-parse", "--short", "HEAD") + ("+" if git("status", "--porcelain", "-uno") else "")
    except (OSError, subprocess.CalledProcessError):
        return "–"


def read(name: str, folder: Path) -> list[dict[str, Any]]:
    """The runs of a benchmark, oldest first."""
    path = folder / f"{name}.jsonl"
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()] if path.exists() else []


def is_time(figure: str) -> bool:
    """Whether a figure is a time, so that more is worse."""
    return "seconds" in figure or figure.endswith(("_ms", "_ms_p50", "_ms_p99", " ms"))


def rows(runs: Sequence[Mapping[str, Any]], figures: Sequence[str]) -> list[list[str]]:
    """One row a run: date, commit, machine and the figures, a slower time marked."""
    found = []
    for index, run in enumerate(runs):
        before = next((old for old in reversed(runs[:index]) if old["machine"] == run["machine"]), None)
        cells = []
        for figure in figures:
            value = run["figures"].get(figure)
            text = "–" if value is None else value if isinstance(value, str) else f"{value:.4g}"
            old = before["figures"].get(figure) if before else None
            slow = is_time(figure) and isinstance(value, float) and isinstance(old, float) and value > SLOWER * old
            cells.append(text + (" !" if slow else ""))
        found.append([run["date"], run["commit"], run["machine"], *cells])
    return found


def table(name: str, runs: Sequence[Mapping[str, Any]], figures: Sequence[str]) -> str:
    """The rows of a benchmark as text, columns aligned."""
    lines = [["date", "commit", "machine", *figures], *rows(runs, figures)]
    widths = [max(len(line[column]) for line in lines) for column in range(len(lines[0]))]
    return "\n".join([
        name, *("  " + "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip()
                for line in lines),
    ])


def main(arguments: Sequence[str] | None = None) -> None:
    """Show the last runs."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.history", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("names", nargs="*", help="benchmarks (all)")
    parser.add_argument("--last", type=int, default=8, help="runs of each")
    parser.add_argument("--figure", action="append", help="figure to show (the first five times); repeatable")
    options = parser.parse_args(arguments)
    folder = history_folder()
    names = options.names or (sorted(path.stem for path in folder.glob("*.jsonl")) if folder else [])
    for name in names:
        runs = read(name, folder)[-options.last:] if folder else []
        known = dict.fromkeys(figure for run in runs for figure in run["figures"])
        print(table(name, runs, options.figure or [figure for figure in known if is_time(figure)][:5]))
    if not names:
        print("no runs yet")


if __name__ == "__main__":
    main()
