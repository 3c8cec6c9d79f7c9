"""Arrays in a safetensors file with a checksum: read without running code, refused when damaged.

Needs NumPy alone. Networks keep torch tensors in the same format, see `mixpinn.networks.tensor_file`.
"""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from mixpinn.base.arrays import AnyArray
from mixpinn.base.errors import InputError
from mixpinn.base.files import atomic_path

_CHECKSUM = "sha256"


def _checksum(arrays: Mapping[str, AnyArray], about: str) -> str:
    digest = hashlib.sha256(about.encode())
    for name in sorted(arrays):
        array = arrays[name]
        # The checksum calls types by torch's names, as the first writer of such files did.
        digest.update(f"{name}torch.{array.dtype.name}{array.shape}".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()


def write_arrays(path: Path | str, arrays: Mapping[str, AnyArray], *, about: object = None) -> None:
    """Write named arrays and, in the same file, `about` as JSON; atomically.

    One file for both: arrays and the text that belongs to them can never be of two different moments.
    """
    plain = {name: np.array(array, order="C") for name, array in arrays.items()}
    text = json.dumps(about)
    with atomic_path(path) as temporary:
        # Written here and not by safetensors, for ordinary permissions and an ordinary error when the disk is full.
        temporary.write_bytes(save(plain, metadata={"about": text, _CHECKSUM: _checksum(plain, text)}))


def read_arrays(path: Path | str) -> tuple[dict[str, AnyArray], object]:
    """Read what `write_arrays` wrote: the arrays and `about`.

    Raises:
        InputError: absent, truncated, altered or not written by `write_arrays`.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(str(path), expected="a safetensors file", got="no such file", fix="check the folder")
    try:
        with safe_open(str(path), framework="np") as file:
            metadata = file.metadata() or {}
            arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (not a mapping)
    except (SafetensorError, OSError, ValueError, TypeError) as error:
        raise InputError(
            str(path), expected="a complete safetensors file", got=f"a damaged one ({error})",
            fix="copy or train the model again",
        ) from error
    text = metadata.get("about", "null")
    if metadata.get(_CHECKSUM) != _checksum(arrays, text):
        raise InputError(
            str(path), expected="contents that match their checksum", got="altered or foreign contents",
            fix="copy or train the model again",
        )
    return arrays, json.loads(text)
