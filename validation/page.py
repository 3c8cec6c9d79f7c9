"""The page of the documentation, written from what the checks found."""

import re
from collections.abc import Sequence
from pathlib import Path

from mixpinn.base.files import atomic_path
from validation.result import Result, Section

HEAD = """# Validation of the finite elements

Written by `python -m validation`; nothing here is typed by hand. Sections that a run leaves out keep what
an earlier run wrote.
"""


def figure(value: float) -> str:
    """A figure with three digits; a dash where there is none."""
    return "–" if value != value else f"{value:.4g}"


def section_text(section: Section, pictures: str) -> str:
    """A section in Markdown."""
    lines = [f"## {section.title}", "", section.text, "", "| check | value | bar | met |", "| --- | --- | --- | --- |"]
    lines += [
        f"| {result.check.replace('|', chr(92) + '|')} | {figure(result.value)} | {result.bar} | "
        f"{'yes' if result.met else 'no'} |" for result in section.results
    ]
    if section.table:
        lines += ["", "| " + " | ".join(section.table[0]) + " |", "|" + " --- |" * len(section.table[0])]
        lines += ["| " + " | ".join(row) + " |" for row in section.table[1:]]
    if section.picture:
        lines += ["", f"![{section.title}]({pictures}/{section.picture})"]
    return "\n".join(lines) + "\n"


def split_page(text: str) -> dict[str, str]:
    """Sections of a page by title."""
    parts = re.split(r"^## ", text, flags=re.MULTILINE)[1:]
    return {part.split("\n", 1)[0].strip(): "## " + part.rstrip("\n") + "\n" for part in parts}


def stored_results(path: Path, title: str) -> tuple[Result, ...]:
    """Figures of the section `title` as the page at `path` has them, to four digits; none where it lacks the section.

    This is where the long checks keep what they found.
    """
    section = split_page(path.read_text(encoding="utf-8")).get(title, "") if path.is_file() else ""
    results: list[Result] = []
    lines = section.splitlines()
    header = "| check | value | bar | met |"
    for line in lines[lines.index(header) + 2:] if header in lines else []:
        if not line.startswith("|"):
            break
        check, value, bar, met = (cell.strip() for cell in line.replace("\\|", "\0").strip("|").split("|"))
        number = float("nan") if value == "–" else float(value)
        results.append(Result(check.replace("\0", "|"), number, bar, met == "yes"))
    return tuple(results)


def write_page(path: Path, sections: Sequence[Section], *, order: Sequence[str]) -> None:
    """Write `sections` into the page at `path`, keeping the page's other sections whose titles are in `order`."""
    texts = split_page(path.read_text(encoding="utf-8")) if path.is_file() else {}
    texts |= {section.title: section_text(section, path.stem) for section in sections}
    page = HEAD + "\n" + "\n".join(texts[title] for title in order if title in texts)
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_path(path) as temporary:
        Path(temporary).write_text(page, encoding="utf-8")
