"""The page's files, read once when a server starts: what is asked for later is looked up by name, never on the disk."""

import mimetypes
from pathlib import Path

FOLDER = Path(__file__).parent / "page"
"""What lies in here is served: ``index.html`` at ``/``, the others by their relative paths."""
_EMPTY = (
    b"<!doctype html><meta charset=utf-8><title>MIXPINN</title><p>This installation has no page. The server works: "
    b"see the live protocol.</p>"
)
_TYPES = {".js": "text/javascript", ".mjs": "text/javascript", ".wasm": "application/wasm", ".json": "application/json"}


def page_files(folder: Path = FOLDER) -> dict[str, tuple[str, bytes]]:
    """Content type and bytes by path; a line of text at ``/`` where the page is absent."""
    found: dict[str, tuple[str, bytes]] = {}
    for path in sorted(folder.rglob("*")) if folder.is_dir() else ():
        name = path.relative_to(folder).as_posix()
        if path.is_file() and path.suffix not in (".py", ".pyc") and not name.startswith("."):
            kind = _TYPES.get(path.suffix) or mimetypes.guess_type(name)[0] or "application/octet-stream"
            found[f"/{name}"] = (f"{kind}; charset=utf-8" if kind.startswith("text/") else kind), path.read_bytes()
    found["/"] = found.get("/index.html", ("text/html; charset=utf-8", _EMPTY))
    return found
