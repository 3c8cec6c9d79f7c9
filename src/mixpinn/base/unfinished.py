"""Files that are being written, and those of writers that were killed, which the next writer beside them removes."""

import contextlib
import os
import shutil
import time
from collections.abc import Iterator
from pathlib import Path

PREFIX = ".writing-"
"""Of the folders in which files are written before they get their name."""
_FRESH = 2.0
"""Younger folders may not be held yet by who made them [s]."""


@contextlib.contextmanager
def held(folder: Path) -> Iterator[None]:
    """Show other processes that the writer of `folder` lives, however this one ends."""
    descriptor = _locked(folder)
    try:
        yield
    finally:
        if descriptor is not None:
            os.close(descriptor)


def sweep(parent: Path) -> None:
    """Remove what killed writers left in `parent`; without locks of the system nothing is removed."""
    with contextlib.suppress(OSError):
        for entry in os.scandir(parent):
            if not entry.name.startswith(PREFIX):
                continue
            with contextlib.suppress(OSError):
                if time.time() - entry.stat(follow_symlinks=False).st_mtime < _FRESH:
                    continue
                descriptor = _locked(Path(entry.path))
                if descriptor is not None:
                    shutil.rmtree(entry.path, ignore_errors=True)
                    os.close(descriptor)


def _locked(folder: Path) -> int | None:
    """A descriptor that holds the lock on a folder; None where another process holds it, or the system has none."""
    try:
        import fcntl
    except ImportError:  # Windows
        return None
    descriptor = None
    try:
        descriptor = os.open(folder, os.O_RDONLY)
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        if descriptor is not None:
            os.close(descriptor)
        return None
    return descriptor
