"""Where heavy intermediate results go: a cache folder keyed by the hash of what they were made from."""

import os
from pathlib import Path


def cache_folder(*parts: str) -> Path:
    """Folder `parts` inside the cache, created if absent.

    The root is the environment variable ``MIXPINN_CACHE``; without it ``$XDG_CACHE_HOME/mixpinn`` or
    ``~/.cache/mixpinn``.
    """
    default = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "mixpinn"
    folder = Path(os.environ.get("MIXPINN_CACHE", default)).joinpath(*parts)
    folder.mkdir(parents=True, exist_ok=True)
    return folder
