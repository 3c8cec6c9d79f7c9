"""Where heavy intermediate results go: a cache folder keyed by the hash of what they were made from."""

import os
from pathlib import Path

from mixpinn.base.compile_cache import user_cache
from mixpinn.base.errors import InputError
from mixpinn.base.files import make_folder


def cache_folder(*parts: str) -> Path:
    """Folder `parts` inside the cache, created if absent.

    The root is the environment variable ``MIXPINN_CACHE``; without it ``$XDG_CACHE_HOME/mixpinn`` or
    ``~/.cache/mixpinn``, and without a home that can be written a folder of the user's in the temporary one.

    Raises:
        InputError: the folder cannot be written.
    """
    given = os.environ.get("MIXPINN_CACHE")
    folder = (Path(given) if given else user_cache() / "mixpinn").joinpath(*parts)
    make_folder(folder)
    return folder


def optional_cache(*parts: str) -> Path | None:
    """The same folder; None where nobody said where the cache is and no place for it can be written.

    Raises:
        InputError: ``MIXPINN_CACHE`` names a folder that cannot be written.
    """
    try:
        return cache_folder(*parts)
    except InputError:
        if os.environ.get("MIXPINN_CACHE"):
            raise
        return None
