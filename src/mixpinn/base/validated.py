"""Validated loading: JSON files as frozen dataclasses, and arrays with kind, shape, range and finiteness checked.

A damaged value is refused in one line that says where it stands, what was expected and how to mend it.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
from pydantic import TypeAdapter, ValidationError

from mixpinn.base.array_file import read_npy
from mixpinn.base.arrays import AnyArray
from mixpinn.base.checksum import with_checksum, without_checksum
from mixpinn.base.errors import InputError
from mixpinn.base.files import read_json, write_json

R = TypeVar("R")
_KINDS = {"number": "fiu", "index": "iu", "flag": "b"}


def load_record(kind: type[R], path: Path | str, *, remake: str, finite: bool = True) -> R:
    """Read a JSON file as `kind`: a dataclass, or any type that pydantic knows; numbers are not read from text.

    Args:
        kind: of the whole file.
        path: of the file.
        remake: what a user does where it is damaged.
        finite: refuse numbers that are not finite.

    Raises:
        InputError: absent, no JSON, a value that is missing, unknown, of another type or not finite.
    """
    values = without_checksum(read_json(path), str(path), remake=remake)
    return checked_record(kind, values, str(path), remake=remake, finite=finite)


def save_record(path: Path | str, record: Any) -> None:
    """Write a dataclass, or values by name, as JSON with a checksum, which `load_record` compares; atomically."""
    write_json(path, with_checksum(asdict(record) if is_dataclass(record) and not isinstance(record, type) else record))


def checked_record(kind: type[R], values: Any, where: str, *, remake: str, finite: bool = True) -> R:
    """Plain values, as JSON holds them, as `kind`; arguments and errors as `load_record`, for values from `where`."""
    if is_dataclass(kind) and isinstance(values, Mapping):
        unknown = sorted(set(values) - {field.name for field in fields(kind)})
        if unknown:
            raise InputError(
                f"{where}: {unknown[0]}", expected="a known entry", got="one that this version does not know",
                fix=remake,
            )
    try:
        # Through text: only there do strict types take a list for a tuple and a word for an enumeration.
        text = json.dumps(values, allow_nan=not finite)
    except ValueError as error:
        raise InputError(where, expected="finite numbers", got="NaN or infinity", fix=remake) from error
    try:
        checked: R = _adapter(kind).validate_json(text, strict=True)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        raise InputError(
            f"{where}: {place}" if place else where, expected=first["msg"].removeprefix("Input should be "),
            got=_short(first.get("input")), fix=remake,
        ) from error
    return checked


_adapters: dict[Any, "TypeAdapter[Any]"] = {}
"""The checks of a type; they take longer to make than to do, and a store has hundreds of records of one kind."""


def _adapter(kind: Any) -> "TypeAdapter[Any]":
    if kind not in _adapters:
        _adapters[kind] = TypeAdapter(kind)
    return _adapters[kind]


@dataclass(frozen=True)
class ArraySpec:
    """What an array must be.

    Attributes:
        kind: numbers, indices (integers) or flags.
        shape: an extent or the name of one on each axis; axes of one name have one extent.
        low, high: smallest and largest value allowed; None for no bound.
        finite: every value is finite.
    """

    kind: Literal["number", "index", "flag"]
    shape: tuple[int | str, ...]
    low: float | None = None
    high: float | None = None
    finite: bool = True

    def check(self, array: AnyArray, where: str, *, extents: dict[str, int], remake: str) -> None:
        """Compare `array` with the specification.

        Args:
            array: what was read.
            where: for the message.
            extents: those of named axes that are known; new ones are added.
            remake: what a user does where it is damaged.

        Raises:
            InputError: another kind or shape, a value out of range or not finite.
        """
        def refuse(expected: str, got: str) -> InputError:
            return InputError(where, expected=expected, got=got, fix=remake)

        self.check_form(array.dtype, array.shape, where, extents=extents, remake=remake)
        if self.finite and array.dtype.kind == "f" and not np.isfinite(array).all():
            raise refuse("finite numbers", f"{int((~np.isfinite(array)).sum())} others")
        for bound, below in ((self.low, True), (self.high, False)):
            if bound is not None and array.size and (array.min() < bound if below else array.max() > bound):
                raise refuse(
                    f"values of at {'least' if below else 'most'} {bound:g}",
                    f"{array.min() if below else array.max()}",
                )

    def check_form(
        self, dtype: "np.dtype[Any]", shape: tuple[int, ...], where: str, *, extents: dict[str, int], remake: str,
    ) -> None:
        """Compare type and shape alone, as a file states them before it is read; operands and errors as `check`."""
        def refuse(expected: str, got: str) -> InputError:
            return InputError(where, expected=expected, got=got, fix=remake)

        if dtype.kind not in _KINDS[self.kind]:
            raise refuse(f"an array of kind '{self.kind}'", str(dtype))
        wanted = tuple(extents.get(axis, axis) if isinstance(axis, str) else axis for axis in self.shape)
        fits = len(shape) == len(wanted) and all(
            isinstance(axis, str) or axis == extent for axis, extent in zip(wanted, shape, strict=True)
        )
        if not fits:
            raise refuse(f"an array of shape ({', '.join(map(str, wanted))})", str(shape))
        for axis, extent in zip(wanted, shape, strict=True):
            if isinstance(axis, str) and extents.setdefault(axis, extent) != extent:
                raise refuse(f"axes '{axis}' of one extent", str(shape))


def load_arrays(
    folder: Path | str, specs: Mapping[str, ArraySpec], *, remake: str, mapped: tuple[str, ...] = (),
    optional: tuple[str, ...] = (), extents: Mapping[str, int] | None = None,
) -> dict[str, AnyArray]:
    """Read ``NAME.npy`` of a folder for each of `specs`, and check them together.

    Args:
        folder: where they lie.
        specs: by name.
        remake: what a user does where one is damaged.
        mapped: names of arrays that are mapped into memory and whose values are not looked at.
        optional: names that may be absent.
        extents: of named axes that are known.

    Raises:
        InputError: absent, unreadable, or not as specified.
    """
    known, arrays = dict(extents or {}), {}
    for name, spec in specs.items():
        path = Path(folder) / f"{name}.npy"
        if name in optional and not path.is_file():
            continue
        try:
            array = read_npy(path, mapped=name in mapped)
        except (OSError, ValueError) as error:
            got = f"{type(error).__name__}: {error}" if isinstance(error, OSError) else str(error)
            raise InputError(str(path), expected="a readable array", got=got, fix=remake) from error
        looked_at = spec if name not in mapped else ArraySpec(spec.kind, spec.shape, finite=False)
        looked_at.check(array, str(path), extents=known, remake=remake)
        arrays[name] = array
    return arrays


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
