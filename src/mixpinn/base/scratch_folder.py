"""Folders in the system's temporary one that do not stay behind, even where their process was killed."""

import contextlib
import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from mixpinn.base.errors import InputError
from mixpinn.base.lock import acquire, release

_PREFIX = "mixpinn-scratch-"
_FRESH = 2.0
"""Younger folders may not be locked yet [s]."""


@contextlib.contextmanager
def scratch_folder() -> Iterator[Path]:
    """A new folder, removed at the end; those that killed processes of this user left are removed, too."""
    _sweep()
    folder = Path(tempfile.mkdtemp(prefix=_PREFIX))
    try:
        acquire(folder)
        yield folder
    finally:
        release(folder)
        shutil.rmtree(folder, ignore_errors=True)


def _sweep() -> None:
    for folder in Path(tempfile.gettempdir()).glob(f"{_PREFIX}*"):
        with contextlib.suppress(OSError, InputError):
            about = folder.stat()
            if hasattr(os, "getuid") and about.st_uid != os.getuid():
                continue
            if time.time() - about.st_mtime < _FRESH or not acquire(folder):
                continue
            release(folder)
            shutil.rmtree(folder, ignore_errors=True)
