"""Section: a part of the page that is collected from a run into a small JSON and rendered from that JSON alone."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

from benchmarks.machine import machine
from mixpinn.base.files import read_json, write_json

Data = dict[str, Any]

OWN_SOLVER = "against its own solver, linear tetrahedra"
"""Kind of figure: what a model learned of the simulations that it was given."""

REFINED = "against its own solver, quadratic tetrahedra refined under the probe"
"""The same, with simulations as onboarding makes them."""

SOFA = "against SOFA's recordings on the same mesh, linear tetrahedra"
"""Kind of figure: the same, with another simulator's fields."""


@dataclass(frozen=True)
class Section:
    """A part of the page.

    Attributes:
        name: of its option and of its file ``docs/results/NAME.json``.
        collect: reads a run (and copies its pictures into the folder of pictures): ``collect(run, images)``.
        render: everything that is stored, as Markdown: a file of its own, ``docs/results/NAME.md``.
        brief: what of it stands on the page of results; None for all of it.
        kind: what errors are measured against; empty where there are no errors.
        metavar, help: of its option.
        several: whether the option may be given several times; `collect` then gets the list.
        default: run directory that is taken, where it is finished, if the option is not given.
    """

    name: str
    collect: Callable[[Any, Path], Data]
    render: Callable[[Data], str]
    brief: Callable[[Data], str] | None = None
    kind: str = ""
    metavar: str = "DIR"
    help: str = ""
    several: bool = False
    default: Path | None = None


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


def full_text(section: Section, data: Data) -> str:
    """Everything that a section has to say, as a page in the folder of results: one level of heading higher."""
    text = re.sub(r"^#(#+ )", r"\1", section.render(data), flags=re.MULTILINE).replace("](images/", "](../images/")
    title, _, rest = text.partition("\n")
    kind = f"Errors are those {section.kind}; see [what they mean](../results.md).\n" if section.kind else ""
    return f"{title}\n\n{kind}{rest}"


def page_text(section: Section, data: Data, folder: str) -> str:
    """The section on the page of results, with a link to the rest of it in `folder`.

    A ``note`` beside stored figures says what has changed since; figures that are collected anew come without one.
    """
    text = (section.brief or section.render)(data)
    title, _, rest = text.partition("\n")
    more = f"[All tables]({folder}/{section.name}.md), [figures as JSON]({folder}/{section.name}.json)."
    kind = f"*Errors {section.kind}.* " if section.kind else ""
    note = f" *{data['note']}*" if data.get("note") else ""
    return f"{title}\n\n{kind}{more}{note}\n{rest}"


def table(columns: Sequence[str], rows: Sequence[Sequence[object]], *, numeric_from: int = 1) -> str:
    """A table in Markdown; columns from `numeric_from` on are aligned to the right."""
    rule = ["---" if index < numeric_from else "---:" for index in range(len(columns))]
    return "\n".join("| " + " | ".join(str(cell) for cell in row) + " |" for row in (columns, rule, *rows)) + "\n"
