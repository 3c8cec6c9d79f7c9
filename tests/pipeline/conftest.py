from .chain import chain  # noqa: F401
