"""One process at a time in a folder: a lock that the system takes back when its process ends, however it ends."""

import contextlib
import os
import time
from collections.abc import Iterator
from contextvars import ContextVar
from pathlib import Path
from typing import IO

from mixpinn.base.errors import InputError
from mixpinn.base.files import make_folder

LOCK_FILE = ".lock"
_PAUSE = 0.1
"""Between two attempts where the system cannot wait for a lock by itself [s]."""
_held: dict[Path, tuple[int, IO[str]]] = {}
"""Number of the process and open lock file by folder; a process that was forked from it does not hold them."""
_scope: ContextVar[list[Path] | None] = ContextVar("_scope", default=None)
"""Folders that were locked since the innermost `given_back` of this thread began."""


def acquire(folder: Path | str, *, wait: bool = False) -> bool:
    """Lock `folder`, which is created if absent, for this process until `release` or its end.

    Args:
        folder: what is locked, by the file ``.lock`` in it.
        wait: wait for another process that holds it, instead of refusing.

    Returns:
        False where this process holds it already.

    Raises:
        InputError: another process holds it.
    """
    folder = Path(folder).absolute()
    if folder in _held and _held[folder][0] == os.getpid():
        return False
    make_folder(folder)
    told = False
    while True:
        file = open(folder / LOCK_FILE, "a+", encoding="ascii", errors="replace")  # noqa: SIM115 (kept open: closing it gives it back)
        if _try_lock(file, wait=told):
            # Whoever gave the lock back has removed its file: ours counts only if it is still the one in the folder.
            with contextlib.suppress(FileNotFoundError):
                if os.path.samestat(os.fstat(file.fileno()), os.stat(folder / LOCK_FILE)):
                    break
            file.close()
            continue
        file.seek(0)
        holder = file.read().strip() or "unknown"
        file.close()
        if not wait:
            raise InputError(
                str(folder), expected="a folder that no other process works in", got=f"process {holder} at work in it",
                fix="wait until it has ended, or choose another output folder",
            )
        if not told:
            from mixpinn.base.progress import console  # imported here: reading a bundle shows no progress

            console.print(f"waiting for process {holder}, which works in {folder}")
        told = True
        time.sleep(_PAUSE)
    file.truncate(0)
    file.write(f"{os.getpid()}\n")
    file.flush()
    _held[folder] = os.getpid(), file
    scope = _scope.get()
    if scope is not None:
        scope.append(folder)
    return True


def release(folder: Path | str) -> None:
    """Give the lock on `folder` back, if this process holds it."""
    folder = Path(folder).absolute()
    process, file = _held.pop(folder, (0, None))
    if file is not None and process == os.getpid():
        with contextlib.suppress(OSError):  # the folder may be gone
            (folder / LOCK_FILE).unlink()
        file.close()


@contextlib.contextmanager
def given_back() -> Iterator[None]:
    """What is locked while this lasts is given back at its end, also after an exception; a decorator too."""
    token = _scope.set([])
    try:
        yield
    finally:
        for folder in _scope.get() or []:
            release(folder)
        _scope.reset(token)


@contextlib.contextmanager
def locked(folder: Path | str, *, wait: bool = False) -> Iterator[None]:
    """Hold the lock on `folder` while this lasts; arguments and errors as `acquire`."""
    mine = acquire(folder, wait=wait)
    try:
        yield
    finally:
        if mine:
            release(folder)


def _try_lock(file: IO[str], *, wait: bool) -> bool:
    """Lock an open file, or say that another process holds it."""
    try:
        import fcntl
    except ImportError:  # Windows
        return _try_lock_windows(file)
    try:
        fcntl.flock(file, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except BlockingIOError:
        return False
    return True


def _try_lock_windows(file: IO[str]) -> bool:
    import importlib

    file.seek(0x7FFF0000)  # a byte far behind the process number, which stays readable
    try:
        locking = importlib.import_module("msvcrt")
        locking.locking(file.fileno(), locking.LK_NBLCK, 1)
    except OSError:
        return False
    return True
