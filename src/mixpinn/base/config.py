"""Configurations: nested frozen dataclasses, overridable by a TOML or JSON file and by `key=value` flags."""

import dataclasses
import json
import math
import tomllib
import types
import typing
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError

from mixpinn.base.errors import InputError
from mixpinn.base.files import each_once
from mixpinn.base.text import read_text

C = TypeVar("C")


def read_config_file(path: Path | str) -> dict[str, Any]:
    """Read a ``.json`` or else TOML configuration, as any editor saves it, as a nested dictionary.

    Raises:
        InputError: absent, unreadable, or of another type.
    """
    path = Path(path)
    text = read_text(path, expected="a configuration file").lstrip("\ufeff").replace("\r\n", "\n")
    try:
        as_json = path.suffix.lower() == ".json"
        values = json.loads(text, object_pairs_hook=each_once) if as_json else tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        hint = "mend the syntax"
        if "\\" in text:
            hint = "write a path with backslashes in single quotes ('C:\\data') or with forward slashes"
        raise InputError(str(path), expected="TOML", got=str(error), fix=hint) from error
    except (ValueError, RecursionError) as error:
        raise InputError(str(path), expected="JSON", got=str(error), fix="mend the syntax") from error
    if not isinstance(values, dict):
        raise InputError(
            str(path), expected="settings by name", got=type(values).__name__, fix='write for example {"seed": 1}',
        )
    return values


def merge(base: Mapping[str, Any], other: Mapping[str, Any]) -> dict[str, Any]:
    """`base` with the entries of `other` laid over it, nested dictionaries merged."""
    merged = dict(base)
    for key, value in other.items():
        nested = isinstance(value, Mapping) and isinstance(merged.get(key), Mapping)
        merged[key] = merge(merged[key], value) if nested else value
    return merged


def parse_overrides(overrides: Sequence[str]) -> dict[str, Any]:
    """Turn ``["train.epochs=3", "mesh.size=2.0"]`` into a nested dictionary; values are read as JSON, else text.

    Raises:
        InputError: an entry has no ``=``.
    """
    result: dict[str, Any] = {}
    for override in overrides:
        key, sign, text = override.partition("=")
        if not sign:
            raise InputError(
                f"--set {override}", expected="KEY=VALUE", got=override, fix="write for example train.max_epochs=3",
            )
        try:
            value: Any = json.loads(text)
        except json.JSONDecodeError:
            value = text
        for name in reversed(key.split(".")):
            value = {name: value}
        result = merge(result, value)
    return result


def _without_none(kind: Any) -> Any:
    """`X` of ``X | None``, else the type itself."""
    options = [option for option in typing.get_args(kind) if option is not type(None)]
    return options[0] if isinstance(kind, types.UnionType) and len(options) == 1 else kind


def _refuse_unknown(kind: Any, values: Mapping[str, Any], where: str) -> None:
    fields = {field.name: field for field in dataclasses.fields(kind)}
    for key, value in values.items():
        if key not in fields:
            raise InputError(
                f"{where}{key}", expected="one of " + ", ".join(fields), got=f"the unknown setting {key!r}",
                fix="check the spelling",
            )
        nested = _without_none(fields[key].type)
        if not isinstance(value, Mapping):
            continue
        if dataclasses.is_dataclass(nested):
            _refuse_unknown(nested, value, f"{where}{key}.")
        elif typing.get_origin(nested) is dict and dataclasses.is_dataclass(typing.get_args(nested)[1]):
            for name, entry in value.items():
                _refuse_unknown(typing.get_args(nested)[1], entry, f"{where}{key}.{name}.")


def _with_none(kind: Any, values: Mapping[str, Any]) -> dict[str, Any]:
    """`values` in which the word none, where a group of settings may be absent, is None: TOML has no null."""
    fields = {field.name: field.type for field in dataclasses.fields(kind)}
    found: dict[str, Any] = {}
    for key, value in values.items():
        nested = _without_none(fields[key])
        group = dataclasses.is_dataclass(nested)
        if group and nested is not fields[key] and value == "none":
            value = None
        found[key] = _with_none(nested, value) if group and isinstance(value, Mapping) else value
    return found


def _refuse_senseless(value: Any, where: str) -> None:
    """No setting means anything that is not finite, and no seed is negative."""
    if isinstance(value, Mapping):
        for key, entry in value.items():
            _refuse_senseless(entry, f"{where}.{key}" if where else str(key))
    elif isinstance(value, list | tuple):
        for entry in value:
            _refuse_senseless(entry, where)
    elif isinstance(value, int) and value < 0 and where.rpartition(".")[2] == "seed":
        raise InputError(where, expected="0 or more", got=str(value), fix="correct the setting")
    elif isinstance(value, float) and not math.isfinite(value):
        raise InputError(where, expected="a finite number", got=repr(value), fix="correct the setting")


def _refuse_switches(given: Any, built: Any, where: str) -> None:
    """No number is meant by true or false, which Python counts as 1 and 0."""
    if isinstance(given, Mapping):
        for key, entry in given.items():
            inner = built.get(key) if isinstance(built, Mapping) else getattr(built, str(key), None)
            _refuse_switches(entry, inner, f"{where}.{key}" if where else str(key))
    elif isinstance(given, list | tuple) and isinstance(built, list | tuple):
        for entry, inner in zip(given, built, strict=False):
            _refuse_switches(entry, inner, where)
    elif isinstance(given, bool) and isinstance(built, int | float) and not isinstance(built, bool):
        raise InputError(where, expected="a number", got=str(given).lower(), fix="correct the setting")


def _defaults(kind: Any) -> dict[str, Any]:
    """Defaults of `kind` as nested dictionaries; none where a setting has no default."""
    required = [
        field for field in dataclasses.fields(kind)
        if field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
    ]
    return {} if required else dataclasses.asdict(kind())


def build_config(kind: type[C], *layers: Mapping[str, Any]) -> C:
    """Build the frozen dataclass `kind` from its defaults overlaid with `layers`, later ones winning.

    The defaults are those of `kind` as a whole: naming one setting of a nested configuration leaves the others as
    the outer one has them. A group that may be absent is so by None or, in TOML, by the word ``none``.

    Raises:
        InputError: an unknown setting or a value of the wrong type; the message names the setting.
    """
    given: dict[str, Any] = {}
    for layer in layers:
        given = merge(given, layer)
    _refuse_unknown(kind, given, "")
    given = _with_none(kind, given)
    _refuse_senseless(given, "")
    values = merge(_defaults(kind), given)
    try:
        built = TypeAdapter(kind).validate_python(values)
    except ValidationError as error:
        first = error.errors()[0]
        raise InputError(
            ".".join(str(part) for part in first["loc"]) or kind.__name__,
            expected=first["msg"].removeprefix("Input should be "),
            got=repr(first.get("input")), fix="correct the setting",
        ) from error
    _refuse_switches(given, built, "")
    return built
