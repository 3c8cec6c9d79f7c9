"""Name tables of multi-label images, in the formats that people have them in."""

import json
import re
from pathlib import Path

from mixpinn.anatomy.names import NAMED_TABLES
from mixpinn.base.errors import InputError
from mixpinn.base.files import each_once
from mixpinn.base.text import read_text
from mixpinn.base.text_table import plain_name, read_rows, split_cells

_FORMATS = "JSON, CSV, a BIDS .tsv, a Slicer .ctbl or ITK-SNAP's label file"
_NUMBERS = ("index", "label", "number", "value", "key", "id", "labelvalue", "label_value")
_VALUES = {"value", "labelvalue", "label_value"}
"""Names of columns beside which an ``index`` may be that of the row."""
_NAMES = ("name", "label_name", "structure", "segment", "segment_name", "label", "abbreviation")
_SLICER = re.compile(r"(-?\d+)\s+(\S+)(?:\s+\d+){3,4}$")
_ITK_SNAP = re.compile(r"(-?\d+)(?:\s+\d+){3}\s+[\d.]+\s+\d+\s+\d+\s+\"(.*)\"$")


def read_names(path: Path | str) -> dict[int, str]:
    """Read a name table.

    JSON is ``{number: name}`` or ``{name: number}``, alone or under the key "labels"; a CSV or ``.tsv`` has a line of
    names of columns (``index`` and ``name``); further a Slicer colour table (``.ctbl``) and ITK-SNAP's label file.
    ``total`` and ``total-v1`` are the classes of TotalSegmentator's versions 2 and 1.

    Raises:
        InputError: absent, unreadable, or not such a table.
    """
    if str(path) in NAMED_TABLES:
        return dict(NAMED_TABLES[str(path)])
    expected = f"a name table ({_FORMATS})"
    text = read_text(path, expected=expected).lstrip("\ufeff").strip()
    if text.startswith(("{", "[")) or Path(path).suffix.lower() == ".json":
        entries = _json_entries(path, text)
    else:
        entries = _line_entries(path, expected)
    entries = [(number, name.strip()) for number, name in entries if number != 0 and name.strip()]
    names = dict(entries)
    if plain := next((name for name in names.values() if name.lstrip("+-").replace(".", "", 1).isdigit()), None):
        raise InputError(
            str(path), expected="a name of each number", got=f"{plain!r}, another number", fix="write the names",
        )
    if not names or min(names) < 0 or len(set(names.values())) < len(entries) or len(names) < len(entries):
        raise InputError(
            str(path), expected="one name a number", got="an empty table, or a number or name that occurs twice",
            fix="give each label a name of its own",
        )
    return names


def _json_entries(path: Path | str, text: str) -> list[tuple[int, str]]:
    try:
        table = json.loads(text, object_pairs_hook=each_once)
        if isinstance(table, dict) and isinstance(table.get("labels"), dict):
            table = table["labels"]
        if not isinstance(table, dict):
            raise ValueError("a list")
        return [_json_entry(key, value) for key, value in table.items()]
    except (ValueError, RecursionError) as error:
        raise InputError(
            str(path), expected='a table such as {"27": "vertebrae_L5"}', got=f"something else ({error})",
            fix=f"write one entry a label, or give {_FORMATS}",
        ) from error


def _json_entry(key: str, value: object) -> tuple[int, str]:
    if isinstance(value, int) and not isinstance(value, bool):
        return value, key
    if not isinstance(value, str):
        raise ValueError(f"{key!r} with something that is neither a number nor a name")
    try:
        return int(key), value
    except ValueError:
        raise ValueError(f"{key!r} and {value!r}, neither of which is a number") from None


def _line_entries(path: Path | str, expected: str) -> list[tuple[int, str]]:
    lines = [(number, line.strip("\ufeff ")) for number, line in read_rows(path, expected=expected)]
    lines = [(number, line) for number, line in lines if not line.startswith("#")]
    for pattern in (_ITK_SNAP, _SLICER):
        matches = [pattern.match(line) for _, line in lines]
        if lines and all(matches):
            rows = [(at, f"{match[1]}\t{match[2]}") for (at, _), match in zip(lines, matches, strict=True) if match]
            return _by_columns(path, rows, "\t", 0, 1, expected)
    for separator in ("\t", ";", ","):
        if not lines or not all(separator in line for _, line in lines):
            continue
        header = [plain_name(cell) for cell in split_cells(lines[0][1], separator)]
        number = next((header.index(name) for name in _NUMBERS if name in header), None)
        name = next((header.index(name) for name in _NAMES if name in header and header.index(name) != number), None)
        rows = lines[1:]
        if number is not None and "index" in header and (other := set(header) & _VALUES):
            raise InputError(
                str(path), expected="one column of numbers", got=f"the columns 'index' and {min(other)!r}",
                fix="leave the column out that does not hold the numbers of the image",
            )
        if number is None or name is None:
            number, name, rows = 0, 1, lines  # without names of columns: number, then name
            if len(header) != 2:
                continue
        return _by_columns(path, rows, separator, number, name, expected)
    raise InputError(str(path), expected=expected, got="lines of another kind", fix="write one 'number,name' a line")


def _by_columns(
    path: Path | str, rows: list[tuple[int, str]], separator: str, number: int, name: int, expected: str,
) -> list[tuple[int, str]]:
    entries = []
    for at, line in rows:
        cells = split_cells(line, separator)
        try:
            value = float(cells[number])
            if value != int(value):
                raise ValueError(cells[number])
            entries.append((int(value), cells[name]))
        except (ValueError, IndexError, OverflowError) as error:
            raise InputError(
                str(path), expected=expected, got=f"no number and name in line {at}: {line!r}",
                fix="write one 'number,name' a line",
            ) from error
    return entries
