"""A table in its four forms."""

import csv
import io

from rich.console import Console

from mixpinn.evaluation import Table, format_cell

TABLE = Table(
    "Errors [mm]", ("Model", "MEE [mm]", "Samples"), (("A", 0.123456, 1234), ("B", None, 7)), "A note [of one line].",
    frozenset({1}),
)


def test_cells_are_readable() -> None:
    cells = (0.12344, 12.344, 1234.5, 12345, None, "text")
    assert [format_cell(cell) for cell in cells] == ["0.1234", "12.34", "1,234.50", "12,345", "–", "text"]


def test_markdown_aligns_numbers() -> None:
    lines = TABLE.markdown().splitlines()
    assert lines[0] == "### Errors [mm]"
    assert lines[2:6] == [
        "| Model | MEE [mm] | Samples |", "| --- | ---: | ---: |", "| A | 0.1235 | 1,234 |", "| B | – | 7 |",
    ]
    assert lines[-1] == "A note [of one line]."


def test_csv_keeps_precision_and_leaves_gaps_empty() -> None:
    rows = list(csv.reader(io.StringIO(TABLE.csv())))
    assert rows == [["Model", "MEE [mm]", "Samples"], ["A", "0.123456", "1234"], ["B", "", "7"]]


def test_terminal_shows_units() -> None:
    console = Console(file=io.StringIO(), width=100)
    console.print(TABLE.rich())
    shown = console.file.getvalue()  # type: ignore[attr-defined]
    for text in ("Errors [mm]", "MEE [mm]", "0.1235", "A note [of one line]."):
        assert text in shown
