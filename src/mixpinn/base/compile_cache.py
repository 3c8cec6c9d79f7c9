"""Where compiled kernels are kept when neither the package's folder nor a home can be written."""

import os
import tempfile
from pathlib import Path


def settle_compile_cache() -> None:
    """Give numba a folder that it can write, before it is imported; a cluster's or a container's install may have none.

    Where ``NUMBA_CACHE_DIR`` can be written, or numba finds a place of its own, nothing is changed. Where there is none
    at all, kernels are compiled in every process and not kept.
    """
    given = os.environ.get("NUMBA_CACHE_DIR")
    home = _home_cache()
    if given:
        candidates = [Path(given)]
    else:
        candidates = [_PACKAGE, *([] if home is None else [home])]
    if any(map(_writable, candidates)):
        return
    folder = _temporary("kernels")
    if _writable(folder):
        os.environ["NUMBA_CACHE_DIR"] = str(folder)
        return
    # Numba refuses to compile what it is asked to keep and cannot.
    from numba.core.dispatcher import Dispatcher

    setattr(Dispatcher, "enable_caching", lambda self: None)  # noqa: B010


_PACKAGE = Path(__file__).resolve().parents[1]


def user_cache() -> Path:
    """The user's cache folder: ``$XDG_CACHE_HOME`` or ``~/.cache``, or one in the temporary folder without a home."""
    if os.environ.get("XDG_CACHE_HOME"):
        return Path(os.environ["XDG_CACHE_HOME"])
    home = _home_cache()
    return home if home is not None and _writable(home) else _temporary("cache")


def _home_cache() -> Path | None:
    try:
        return Path.home() / ".cache"
    except RuntimeError:  # a user without an entry in the list of users
        return None


def _temporary(kind: str) -> Path:
    """The user's own folder in the temporary one."""
    user = os.getuid() if hasattr(os, "getuid") else 0
    try:
        folder = tempfile.gettempdir()
    except FileNotFoundError:  # none can be written
        folder = "/tmp"
    return Path(folder) / f"mixpinn-{kind}-{user}"


def _writable(folder: Path) -> bool:
    """Whether a folder can be written, or created."""
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    return os.access(folder, os.W_OK)
