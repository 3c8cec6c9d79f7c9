"""Whole-or-nothing file writes, JSON, and content hashes."""

import contextlib
import errno
import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mixpinn.base.arrays import AnyArray
from mixpinn.base.errors import InputError
from mixpinn.base.unfinished import PREFIX, held, sweep

NO_RIGHT = (errno.EACCES, errno.EPERM, errno.EROFS)
"""What the system says where permission is wanting."""
NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, *NO_RIGHT)
"""What the system says where a file cannot be written for want of room or permission."""
NO_PATH = (errno.ENAMETOOLONG, errno.ELOOP, errno.ENOENT, errno.ENOTDIR, errno.EISDIR, errno.EINVAL, errno.EIO,
           errno.ESTALE)
"""What it says of a path that leads to no file, or of a drive that is gone."""
_FOREIGN = ("thumbs.db", "desktop.ini", "ehthumbs.db")


def is_foreign(name: str) -> bool:
    """Whether a file of this name is a file manager's or an unfinished one: hidden files, ``Thumbs.db``."""
    return name.startswith(".") or name.lower() in _FOREIGN


def make_folder(folder: Path | str) -> None:
    """Create `folder` and those above it, if absent.

    Raises:
        InputError: a file is in the way, or the folder cannot be written.
    """
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError) as error:
        raise InputError(
            str(folder), expected="a folder", got="a path through an existing file", fix="choose another output folder",
        ) from error
    except OSError as error:
        raise _no_room(folder, error) from error


def _no_room(path: Path | str, error: OSError) -> Exception:
    if error.errno not in (None, *NO_ROOM):  # None: a library says no more than that it failed
        return error
    return InputError(
        str(path), expected="a folder with room to write", got=error.strerror or str(error),
        fix="free some space or choose another output folder",
    )


@contextlib.contextmanager
def atomic_path(path: Path | str) -> Iterator[Path]:
    """Yield a temporary path beside `path`; on success rename it to `path`, on failure remove it.

    What killed writers left beside it is removed. The temporary name keeps the suffixes of `path`, since many writers
    choose their format by them.

    Raises:
        InputError: the folder cannot be written, a folder is in the way, or the disk is full.
    """
    path = Path(path)
    make_folder(path.parent)
    try:
        sweep(path.parent)
        folder = Path(tempfile.mkdtemp(prefix=PREFIX, dir=path.parent))
    except OSError as error:
        raise _no_room(path, error) from error
    temporary = folder / path.name
    try:
        with held(folder):
            yield temporary
            _to_disk(temporary)
            os.replace(temporary, path)
    except IsADirectoryError as error:
        raise InputError(
            str(path), expected="the path of a file", got="a folder", fix="choose another name for the output",
        ) from error
    except OSError as error:
        raise _no_room(path, error) from error
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _to_disk(path: Path) -> None:
    """Have the system write a file, or the files of a folder, before its name says that it is complete."""
    for part in [path] if path.is_file() else [part for part in path.rglob("*") if part.is_file()]:
        descriptor = os.open(part, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def write_text(path: Path | str, text: str) -> None:
    """Write `text` to `path` atomically."""
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _plain(value: Any) -> Any:
    if is_dataclass(value) and not isinstance(value, type):
        return asdict(value)
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"cannot write {type(value).__name__} as JSON")


def plain_values(value: Any) -> Any:
    """`value` (plain types, dataclasses, arrays, paths) as JSON gives it back."""
    return json.loads(json.dumps(value, default=_plain))


def write_json(path: Path | str, value: Any) -> None:
    """Write `value` (plain types, dataclasses, arrays, paths) to `path` as indented JSON, atomically."""
    write_text(path, json.dumps(value, indent=2, default=_plain) + "\n")


def read_json(path: Path | str) -> Any:
    """Read a JSON file.

    Raises:
        InputError: the file is absent or is not JSON, or an object of it has an entry twice.
    """
    path = Path(path)
    try:
        return json.loads(path.read_text(encoding="utf-8-sig"), object_pairs_hook=each_once)
    except FileNotFoundError as error:
        raise InputError(str(path), expected="a JSON file", got="no such file", fix="check the path") from error
    except (IsADirectoryError, NotADirectoryError) as error:
        raise InputError(
            str(path), expected="a JSON file", got=error.strerror or str(error), fix="check the path",
        ) from error
    except (ValueError, RecursionError) as error:  # also numbers of thousands of digits, and brackets without end
        raise InputError(str(path), expected="valid JSON", got=str(error), fix="write the file again") from error


def each_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """The entries of a JSON object, of which none is given twice.

    Raises:
        ValueError: one is.
    """
    table = dict(pairs)
    if len(table) < len(pairs):
        keys = [key for key, _ in pairs]
        raise ValueError(f"an entry that occurs twice: {next(key for key in keys if keys.count(key) > 1)!r}")
    return table


def hash_file(path: Path | str) -> str:
    """SHA-256 of a file's bytes, 64 hex digits."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def hash_arrays(*arrays: AnyArray) -> str:
    """SHA-256 over shapes, types and contents of arrays, 16 hex digits: the identity of a record."""
    digest = hashlib.sha256()
    for array in arrays:
        array = np.ascontiguousarray(array)
        digest.update(f"{array.dtype.str}{array.shape}".encode())
        digest.update(array.data)
    return digest.hexdigest()[:16]
