"""What a verb writes: results on standard output, everything else on standard error."""

import sys
from typing import Any

_WIDTH = 120
"""Columns of a table that goes into a file or a pipe."""


def say(result: Any) -> None:
    """Write a result: a line of text, or a table of `rich`."""
    if isinstance(result, str):
        print(result)
        return
    from rich.console import Console

    Console(width=None if sys.stdout.isatty() else _WIDTH).print(result)


def warn(text: str) -> None:
    """Write a warning, which is no part of the result."""
    print(f"Warning: {text}", file=sys.stderr)
