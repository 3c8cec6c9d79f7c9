"""How large an image of labels may be: what its header claims is looked at before any of it is unpacked."""

import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mixpinn.base.bounded import first_bytes, require_memory, unpack
from mixpinn.base.errors import InputError

MOST_VOXELS = 1 << 30
"""A label map with more is taken for damaged: a whole body of 1 mm voxels has a quarter of it."""
_HEAD = 540
"""Bytes of the longest header of a NIfTI."""
_MOST_EXTENSIONS = 16 << 20
"""Bytes that extensions of its header, and what lies behind the image, may have."""


def check_extents(shape: Sequence[int], itemsize: int, what: str) -> int:
    """Bytes of an image that a header claims.

    Args:
        shape: extents along the axes.
        itemsize: bytes of a voxel.
        what: the image, for messages.

    Raises:
        InputError: no extents of an image, more voxels than a label map can have, or more than fits into memory.
    """
    if not shape or min(shape) < 0:
        raise InputError(what, expected="extents of an image", got=str(tuple(shape)), fix="copy or write it again")
    voxels, held = math.prod(shape), " × ".join(map(str, shape))
    if voxels > MOST_VOXELS:
        raise InputError(what, expected=f"at most {MOST_VOXELS:,} voxels", got=held, fix="crop or resample it")
    require_memory(voxels * itemsize, what=what, holds=f"{held} voxels", fix="crop or resample it")
    return voxels * itemsize


def nifti_head(path: Path) -> bytes:
    """The beginning of a NIfTI, unpacked where it is packed: enough for any header."""
    with path.open("rb") as file:
        content = file.read(1 << 16)
    return first_bytes(content, "gzip", _HEAD) if _packed(content) else content


def nifti_claim(kind: Any, head: bytes, what: str) -> int:
    """The most bytes that a NIfTI can have.

    Args:
        kind: nibabel's class of the image.
        head: what `nifti_head` gave.
        what: the image, for messages.

    Raises:
        InputError: it is larger than a label map can be.
        Exception: nibabel cannot make out the header.
    """
    header = kind.header_class(head[:kind.header_class.template_dtype.itemsize], check=False)
    size = check_extents(
        [int(extent) for extent in header.get_data_shape()], int(header.get_data_dtype().itemsize), what,
    )
    start = float(header["vox_offset"])
    return size + (int(start) if 0.0 <= start < _MOST_EXTENSIONS else 0) + _MOST_EXTENSIONS


def nifti_content(path: Path, *, most: int) -> bytes | bytearray:
    """All of a NIfTI, unpacked where it is packed.

    Raises:
        ValueError: damaged, or more than `most` bytes.
    """
    content = path.read_bytes()
    return unpack(content, "gzip", most=most) if _packed(content) else content  # to its end: the checksum counts


def read_labels(path: Path) -> Any:
    """The voxels of a NIfTI-1 that this project wrote.

    Raises:
        InputError: larger than a label map can be.
        Exception: damaged; nibabel and NumPy raise many kinds.
    """
    import nibabel as nib

    content = nifti_content(path, most=nifti_claim(nib.Nifti1Image, nifti_head(path), str(path)))
    return nib.Nifti1Image.from_stream(io.BytesIO(content)).dataobj


def _packed(content: bytes) -> bool:
    return content[:2] == b"\x1f\x8b"
