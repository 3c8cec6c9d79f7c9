"""Section: a part of the page that is collected from a run into a small JSON and rendered from that JSON alone."""

import os
import platform
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

from mixpinn.base.files import read_json, write_json

Data = dict[str, Any]


@dataclass(frozen=True)
class Section:
    """A part of the page.

    Attributes:
        name: of its option and of its file ``docs/results/NAME.json``.
        collect: reads a run (and copies its pictures into the folder of pictures): ``collect(run, images)``.
        render: the stored figures as Markdown.
        metavar, help: of its option.
        several: whether the option may be given several times; `collect` then gets the list.
        default: run directory that is taken, where it is finished, if the option is not given.
    """

    name: str
    collect: Callable[[Any, Path], Data]
    render: Callable[[Data], str]
    metavar: str = "DIR"
    help: str = ""
    several: bool = False
    default: Path | None = None


def machine() -> str:
    """Name of the processor and number of cores."""
    name = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        lines = [line for line in info.read_text().splitlines() if line.startswith("model name")]
        name = lines[0].split(":", 1)[1].strip() if lines else name
    return f"{name}, {os.cpu_count()} cores"


def store(folder: Path, section: Section, given: Any, images: Path) -> None:
    """Collect a section from a run and keep its figures."""
    data = section.collect(given, images)
    write_json(folder / f"{section.name}.json", {
        "section": section.name, "machine": machine(), "collected": date.today().isoformat(), **data,
    })


def stored(folder: Path, section: Section) -> Data | None:
    """The figures that an earlier command has kept; None where there are none."""
    path = folder / f"{section.name}.json"
    return read_json(path) if path.exists() else None


def table(columns: Sequence[str], rows: Sequence[Sequence[object]], *, numeric_from: int = 1) -> str:
    """A table in Markdown; columns from `numeric_from` on are aligned to the right."""
    rule = ["---" if index < numeric_from else "---:" for index in range(len(columns))]
    return "\n".join("| " + " | ".join(str(cell) for cell in row) + " |" for row in (columns, rule, *rows)) + "\n"
