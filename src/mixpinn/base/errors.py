"""Errors that a user can mend: one line that says what was expected, what came, and what to do."""

from collections.abc import Callable


class MixpinnError(Exception):
    """Base of all errors that the command line reports in one line."""


class InputError(MixpinnError):
    """An input is not usable.

    Args:
        what: the thing that is wrong, as the user names it (a path, a structure, an option).
        expected: what would have been right.
        got: what came instead.
        fix: how to mend it.

    Example:
        >>> str(InputError("vertebrae_L3.nii.gz", expected="at least one voxel", got="an empty label map",
        ...                fix="segment the structure again or leave it out with --parts"))
        'vertebrae_L3.nii.gz: expected at least one voxel, got an empty label map; segment ...'
    """

    def __init__(self, what: str, *, expected: str, got: str, fix: str) -> None:
        self.what, self.expected, self.got, self.fix = what, expected, got, fix
        super().__init__(" ".join(f"{what}: expected {expected}, got {got}; {fix}".split()))


    def __reduce__(self) -> tuple[Callable[..., "InputError"], tuple[str, str, str, str]]:
        """What another process makes the same error of."""
        return _again, (self.what, self.expected, self.got, self.fix)


def _again(what: str, expected: str, got: str, fix: str) -> InputError:
    return InputError(what, expected=expected, got=got, fix=fix)


class SolveError(MixpinnError):
    """A numerical solve did not reach its tolerance."""
