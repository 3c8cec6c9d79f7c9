"""Settings that make sense: one way to refuse those that do not, when they are made."""

from collections.abc import Mapping

from mixpinn.base.errors import InputError

_LARGEST = 1e12
"""Beyond which a setting is a slip, in whatever unit."""


def require_settings(settings: object, group: str, checks: Mapping[str, tuple[bool, str]]) -> None:
    """Refuse the first setting whose check failed.

    Args:
        settings: the record of settings.
        group: what it is called, for the message.
        checks: by name of the setting whether it makes sense, and what would; a comparison with NaN is false.

    Raises:
        InputError: a check failed.
    """
    for name, (met, expected) in checks.items():
        if not met:
            raise InputError(
                f"{group}.{name}", expected=expected, got=repr(getattr(settings, name)), fix="correct the setting",
            )


def positive(settings: object, *names: str) -> dict[str, tuple[bool, str]]:
    """Checks that settings are above 0, and no larger than anything that is measured."""
    return {name: (0.0 < getattr(settings, name) <= _LARGEST, "a positive number") for name in names}


def not_negative(settings: object, *names: str) -> dict[str, tuple[bool, str]]:
    """Checks that settings are 0 or more, and no larger than anything that is measured."""
    return {name: (0.0 <= getattr(settings, name) <= _LARGEST, "0 or more") for name in names}
