"""Tables of numbers as spreadsheets, NumPy and people write them, read by the names of their columns."""

import csv
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from mixpinn.base.arrays import FloatArray
from mixpinn.base.errors import InputError
from mixpinn.base.text import read_text

Row = tuple[int, list[str]]
"""Number of the line, and its cells."""

_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?$")
_FAULT = re.compile(
    r"#(?:N/A\b|NV\b|(?:REF|VALUE|DIV/0|NAME|NUM|NULL|SPILL|CALC|BEZUG|WERT|ZAHL|VALEUR|NOM|NOMBRE)[!?])",
)
"""What a spreadsheet writes into a cell that it cannot compute, which is no comment."""
_UNIT = re.compile(r"[\[(]\s*([^\])]*?)\s*[\])]\s*$")
_UNIT_BESIDE = re.compile(r"\bunits?\s*(?:[:=\[(]|\bis\b|\bare\b|\bin\b)\s*[\[(\"']*([a-zµ]+)", re.IGNORECASE)
_UNITS = {
    **{unit: unit for unit in ("mm", "cm", "dm", "m", "um", "µm", "in")}, "inch": "in", "inches": "in", "micron": "um",
    **{f"{kind}met{end}": unit for kind, unit in (("milli", "mm"), ("centi", "cm"), ("", "m"), ("micro", "um"))
       for end in ("re", "er", "res", "ers")},
}
"""Units of length by what people call them."""


def read_rows(path: Path | str, *, expected: str) -> list[tuple[int, str]]:
    """Lines of a text file that hold something, with their numbers from 1; ``#`` lines are kept.

    Raises:
        InputError: absent or no text.
    """
    lines = enumerate(read_text(path, expected=expected).replace("\r\n", "\n").replace("\r", "\n").split("\n"), start=1)
    return [(number, line) for number, line in lines if line.strip(" \t,;\ufeff\"'")]


def split_cells(line: str, separator: str) -> list[str]:
    """Cells of a line; a blank as separator stands for any run of white space."""
    if separator == " ":
        return line.split()
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=separator))]
    except csv.Error:  # a cell without end, or a zero
        return line.split(separator)


def read_columns(
    path: Path | str, columns: Mapping[str, Sequence[str]], *, unit: str, expected: str, fix: str,
    doubt: Callable[[FloatArray], str] = lambda rows: "",
) -> FloatArray:
    """Read the named columns of a table of numbers, shape (rows, columns).

    A line of names above the numbers (``# `` before it or not) decides which column is which; without one there must
    be exactly the columns asked for, in their order. Cells stand apart by tabs, semicolons, commas or blanks; a decimal
    comma is read where the separator is none. Blank rows and other lines with ``#`` are passed over.

    Args:
        path: the file.
        columns: further names that each column may bear, by its name.
        unit: the unit that a name may state in brackets; another one is refused.
        expected: what the file should be, for messages.
        fix: how to mend it.
        doubt: says of the rows of a table without names why their order cannot be trusted; nothing where it can.

    Raises:
        InputError: absent, no text, names that do not say which column is which, no names where the order is in doubt,
            a cell that is no number, or rows of different lengths.
    """
    path = Path(path)
    comments, rows = _split_comments(read_rows(path, expected=expected))
    for _, line in comments:
        if stated := _UNIT_BESIDE.search(line):
            require_unit(stated[1], unit, f"{path}: {line[:60]!r}", fix=fix)
    if not rows:
        raise InputError(str(path), expected=expected, got="no row", fix=fix)
    header = rows[0][1] if not _has_number(rows[0][1]) else None
    named = header is not None
    if header is not None:
        rows = rows[1:]
        if not rows:
            raise InputError(str(path), expected=expected, got="names of columns and no row", fix=fix)
    elif comments and comments[-1][0] < rows[0][0]:
        header = comments[-1][1]
    separator, cells = _cells(path, rows, expected=expected, fix=fix, least=len(columns))
    order = None
    if header is not None:
        order = _order(path, header, separator, columns, unit=unit, fix=fix, width=len(cells[0]), strict=named)
    if order is None:
        if len(cells[0]) != len(columns):
            got = f"{len(cells[0])} columns without names"
            raise InputError(str(path), expected=f"{len(columns)} columns ({', '.join(columns)})", got=got, fix=fix)
        if why := doubt(np.array(cells, dtype=np.float64)):
            raise InputError(str(path), expected=f"the names of its columns ({', '.join(columns)})", got=why, fix=fix)
        order = list(range(len(columns)))
    return np.array([[row[index] for index in order] for row in cells], dtype=np.float64)


def _split_comments(lines: list[tuple[int, str]]) -> tuple[list[tuple[int, str]], list[tuple[int, str]]]:
    comments, rows = [], []
    for number, line in lines:
        text = line.lstrip("\ufeff").strip()
        if text.startswith(("#", "%", "//")) and not _FAULT.match(text):
            comments.append((number, text.lstrip("#%/ \t")))
        else:
            rows.append((number, line if _FAULT.search(line) else line.partition("#")[0]))
    return comments, rows


def _has_number(line: str) -> bool:
    return any(_number(word.strip("\"'"), comma=True) is not None for word in re.split(r"[\s;,]+", line) if word)


def _number(cell: str, *, comma: bool) -> float | None:
    text = cell.strip().strip("\"'").strip()
    if comma and _DECIMAL_COMMA.match(text):
        text = text.replace(",", ".")
    try:
        return float(text) if "_" not in text else None
    except ValueError:
        return None


def _cells(
    path: Path, rows: list[tuple[int, str]], *, expected: str, fix: str, least: int,
) -> tuple[str, list[list[float]]]:
    """The separator by which every row is numbers, and the numbers."""
    problem = ""
    for separator in ("\t", ";", ",", " "):
        if separator != " " and not all(separator in line for _, line in rows):
            continue
        table: list[list[float]] = []
        for number, line in rows:
            cells = split_cells(line, separator)
            while len(cells) > max(least, len(table[0]) if table else 0) and not cells[-1]:
                cells.pop()  # spreadsheets end rows with empty cells
            values = [_number(cell, comma=separator != ",") for cell in cells]
            wrong = next((cell for cell, value in zip(cells, values, strict=True) if value is None), None)
            if wrong is not None:
                problem = problem or f"{wrong!r} in line {number}" if wrong else f"an empty cell in line {number}"
                break
            if len(values) < least or (table and len(values) != len(table[0])):
                problem = problem or f"{len(values)} columns in line {number}"
                break
            table.append([value for value in values if value is not None])
        else:
            return separator, table
    raise InputError(str(path), expected=expected, got=problem or "no numbers", fix=fix)


def require_unit(stated: str, unit: str, where: str, *, fix: str) -> None:
    """Refuse a file that says its lengths are in another unit than `unit`; what is no unit of length says nothing.

    Raises:
        InputError: it does.
    """
    if _UNITS.get(stated.strip().lower(), unit) != unit:
        raise InputError(where, expected=f"lengths in {unit}", got=stated, fix=fix)


def plain_name(cell: str) -> str:
    """A column's name without quotes, unit, case and blanks."""
    text = cell.strip().strip("\ufeff\"'").strip().lower()
    return re.sub(r"[\s\-]+", "_", _UNIT.sub("", text).strip())


def _order(
    path: Path, header: str, separator: str, columns: Mapping[str, Sequence[str]], *, unit: str, fix: str, width: int,
    strict: bool,
) -> list[int] | None:
    """Index of each column by the line of names; None where a comment is no such line."""
    cells = split_cells(header, separator)
    while len(cells) > width and not cells[-1]:
        cells.pop()
    names = [plain_name(cell) for cell in cells]
    known = {alias: name for name, aliases in columns.items() for alias in (name, *aliases)}
    found = [known.get(name) for name in names]
    if not strict and (len(names) != width or sum(name is not None for name in found) < 2):
        return None
    missing = [name for name in columns if found.count(name) != 1]
    if missing or len(names) != width:
        got = f"the names {', '.join(cells)}" + (f" over {width} columns" if len(names) != width else "")
        raise InputError(str(path), expected=f"the columns {', '.join(columns)}, each once", got=got, fix=fix)
    for cell in cells:
        stated = _UNIT.search(cell.strip().strip("\"'"))
        if known.get(plain_name(cell)) and stated and stated[1].lower() not in ("", unit, "-", "1", "id"):
            raise InputError(str(path), expected=f"lengths in {unit}", got=f"a column {cell!r}", fix=fix)
    return [found.index(name) for name in columns]
