"""Where compiled kernels are kept when neither the package's folder nor a home can be written."""

import os
import tempfile
from pathlib import Path


def settle_compile_cache() -> None:
    """Give numba a folder that it can write, before it is imported; a cluster's or a container's install may have none.

    Where ``NUMBA_CACHE_DIR`` is set, or numba finds a place of its own, nothing is changed.
    """
    if os.environ.get("NUMBA_CACHE_DIR"):
        return
    package = Path(__file__).resolve().parents[1]
    home = _home_cache()
    if os.access(package, os.W_OK) or (home is not None and _writable(home)):
        return
    os.environ["NUMBA_CACHE_DIR"] = str(_temporary("kernels"))


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
    return Path(tempfile.gettempdir()) / f"mixpinn-{kind}-{user}"


def _writable(folder: Path) -> bool:
    """Whether a folder can be written, or created."""
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    return os.access(folder, os.W_OK)
