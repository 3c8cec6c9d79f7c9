"""Settings and objects as plain values that survive a round trip through JSON."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from mixpinn.base.files import hash_arrays
from mixpinn.records.probe import Probe
from mixpinn.records.tissue_mesh import TissueMesh

KIND = "kind"
"""Name of a recorded object's class."""


def plain(value: Any) -> Any:
    """A setting as plain values: objects by the name of their class and their fields, geometry by its hash."""
    if isinstance(value, Probe | TissueMesh):
        return value.hash()
    if isinstance(value, np.ndarray):
        return hash_arrays(value)
    if is_dataclass(value) and not isinstance(value, type):
        return {KIND: _kind(value)} | {
            field.name: plain(getattr(value, field.name)) for field in fields(value) if field.name != "threads"
        }
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        return value.item()
    return value if isinstance(value, str | int | float | bool | None) else _kind(value)


def _kind(value: object) -> str:
    """Name of the value's class, with its module where it is not one of this package."""
    kind = type(value)
    return kind.__name__ if kind.__module__.startswith("mixpinn.") else f"{kind.__module__}.{kind.__qualname__}"
