"""Reading ``.npy`` and ``.npz`` whose headers are believed only as far as the files are long; nothing is unpickled."""

import io
import math
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import IO

import numpy as np

from mixpinn.base.arrays import AnyArray
from mixpinn.base.bounded import memory_at_hand

_HEADERS = {
    (1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0,
}


def read_npy(path: Path | str, *, mapped: bool = False) -> AnyArray:
    """Read an array.

    Args:
        path: the file.
        mapped: map it into memory instead of reading it.

    Raises:
        OSError: absent or unreadable.
        ValueError: damaged, an array of objects, or as long as its header does not say.
    """
    path = Path(path)
    with path.open("rb") as file:
        shape, fortran, dtype = _header(file)
        start, size = file.tell(), path.stat().st_size
        _require_length(shape, dtype, size - start)
        if not mapped:
            _require_room(size)
            return _in_shape(np.fromfile(file, dtype), shape, fortran=fortran)
    return np.memmap(path, dtype=dtype, mode="r", offset=start, shape=shape, order="F" if fortran else "C")


def read_npz(
    path: Path | str, names: Sequence[str] | None = None, *, most: int = 1 << 30,
) -> dict[str, AnyArray]:
    """Read arrays of an archive by name; without `names` all.

    Args:
        path: the file.
        names: of the arrays that are wanted.
        most: size that one of them may have, unpacked [byte].

    Raises:
        OSError: absent or unreadable.
        KeyError: one of `names` is absent.
        ValueError: damaged, an array of objects, or larger than it says.
    """
    arrays: dict[str, AnyArray] = {}
    try:
        with zipfile.ZipFile(path) as archive:
            members = {member.filename: member for member in archive.infolist()}
            for name in names if names is not None else [key.removesuffix(".npy") for key in members]:
                member = members.get(f"{name}.npy")
                if member is None:
                    raise KeyError(f"{name} is not among {', '.join(sorted(members)) or 'its arrays'}")
                if member.file_size > most:
                    raise ValueError(f"{name}: {member.file_size / 1e9:.1f} GB, more than can be meant")
                _require_room(member.file_size)
                with archive.open(member) as packed:
                    content = packed.read(member.file_size + 1)
                if len(content) != member.file_size:
                    raise ValueError(f"{name}: another size than its entry says")
                file = io.BytesIO(content)
                shape, fortran, dtype = _header(file)
                _require_length(shape, dtype, len(content) - file.tell())
                flat = np.frombuffer(bytearray(content[file.tell():]), dtype)
                arrays[name] = _in_shape(flat, shape, fortran=fortran)
    except (OSError, KeyError, ValueError):
        raise
    except Exception as error:  # zip, zlib and the parts of Python that they use each raise their own kinds
        raise ValueError(f"{type(error).__name__}: {error}") from error
    return arrays


def _header(file: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype]:
    """Shape, order and type that the header states."""
    try:
        version = np.lib.format.read_magic(file)
    except ValueError as error:
        raise ValueError("something else") from error
    try:
        shape, fortran, dtype = _HEADERS[version](file)
    except Exception as error:  # the header is parsed as Python's literals, which can fail in many ways
        raise ValueError(f"a header that cannot be read ({type(error).__name__})") from error
    if dtype.hasobject or dtype.itemsize == 0:
        raise ValueError("an array of objects")
    if any(extent < 0 for extent in shape):
        raise ValueError(f"the shape {shape}")
    return shape, fortran, dtype


def _require_length(shape: tuple[int, ...], dtype: np.dtype, length: int) -> None:
    expected = math.prod(shape) * dtype.itemsize
    if expected != length:
        raise ValueError(f"{length} bytes where its header says {expected}")


def _require_room(size: int) -> None:
    if size > memory_at_hand():
        raise ValueError(f"{size / 1e9:.1f} GB, which do not fit into the memory at hand")


def _in_shape(flat: AnyArray, shape: tuple[int, ...], *, fortran: bool) -> AnyArray:
    return flat.reshape(shape[::-1]).T if fortran else flat.reshape(shape)
