"""Table: a titled table that can be shown in the terminal, in Markdown, as CSV and in the report."""

import csv
import io
from dataclasses import dataclass

import rich.table
from rich.markup import escape

Cell = str | int | float | None


@dataclass(frozen=True)
class Table:
    """A titled table.

    Attributes:
        title: one line.
        columns: headings, with units in brackets.
        rows: cells; None is shown as a dash.
        note: what a reader must know beside the figures.
        muted: indices of the rows that are quoted and not measured here.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ""
    muted: frozenset[int] = frozenset()

    def texts(self) -> list[list[str]]:
        """The cells as they are shown."""
        return [[format_cell(cell) for cell in row] for row in self.rows]

    def numeric(self) -> list[bool]:
        """Whether each column holds numbers, which are aligned to the right."""
        return [
            not any(isinstance(row[column], str) for row in self.rows) for column in range(len(self.columns))
        ]

    def markdown(self) -> str:
        """The table in Markdown, its title a heading of the third level, its note below."""
        rule = ["---:" if numeric else "---" for numeric in self.numeric()]
        lines = ["| " + " | ".join(row) + " |" for row in [list(self.columns), rule, *self.texts()]]
        return "\n".join([f"### {self.title}", "", *lines, *(["", self.note] if self.note else [])]) + "\n"

    def csv(self) -> str:
        """The table as CSV with full precision; empty where there is no value."""
        buffer = io.StringIO()
        writer = csv.writer(buffer, lineterminator="\n")
        writer.writerow(self.columns)
        writer.writerows(["" if cell is None else cell for cell in row] for row in self.rows)
        return buffer.getvalue()

    def rich(self) -> rich.table.Table:
        """The table for a terminal."""
        # Brackets are rich's markup: every text is escaped for the sake of its units.
        shown = rich.table.Table(title=escape(self.title), caption=escape(self.note) or None)
        for heading, numeric in zip(self.columns, self.numeric(), strict=True):
            shown.add_column(escape(heading), justify="right" if numeric else "left")
        for index, row in enumerate(self.texts()):
            shown.add_row(*(escape(cell) for cell in row), style="dim" if index in self.muted else None)
        return shown


def format_cell(cell: Cell) -> str:
    """A cell as text: four decimals below ten and two above, thousands separated, a dash for nothing."""
    if cell is None:
        return "–"
    if isinstance(cell, float):
        return f"{cell:.4f}" if abs(cell) < 10.0 else f"{cell:,.2f}"
    return f"{cell:,}" if isinstance(cell, int) else cell
