"""A checksum inside a JSON file, of all that stands beside it: for small files that no manifest lists."""

import hashlib
import json
from collections.abc import Mapping
from typing import Any

from mixpinn.base.errors import InputError
from mixpinn.base.files import plain_values

_CHECKSUM = "sha256"


def with_checksum(values: Mapping[str, Any]) -> dict[str, Any]:
    """Plain values, dataclasses and arrays as JSON keeps them, and their checksum as the last entry."""
    plain: dict[str, Any] = plain_values(values)
    return {**plain, _CHECKSUM: _digest(plain)}


def without_checksum(values: Any, where: str, *, remake: str) -> Any:
    """What `with_checksum` was given; values without a checksum, of an older version, stay as they are.

    Args:
        values: that a JSON file held.
        where: for the message.
        remake: what a user does where it is damaged.

    Raises:
        InputError: values that the checksum does not fit.
    """
    if not isinstance(values, dict) or _CHECKSUM not in values:
        return values
    rest = {key: value for key, value in values.items() if key != _CHECKSUM}
    if values[_CHECKSUM] != _digest(rest):
        raise InputError(
            where, expected="contents that fit their checksum", got="others: the file was altered after it was made",
            fix=remake,
        )
    return rest


def _digest(values: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()
