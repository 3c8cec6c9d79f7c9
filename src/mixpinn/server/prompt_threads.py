"""Threads that talk to clients beside one that predicts."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager

_SWITCH = 0.0005
"""Who waits for Python's lock gets it after this time [s]: messages must not wait for predictions."""


@contextmanager
def prompt_threads() -> Iterator[None]:
    """Meanwhile no thread keeps Python's lock for long where another one waits for it."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(_SWITCH)
    try:
        yield
    finally:
        sys.setswitchinterval(before)
