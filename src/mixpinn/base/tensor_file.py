"""Tensors in a safetensors file with a checksum: read without running code, refused when damaged."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save

from mixpinn.base.errors import InputError
from mixpinn.base.files import atomic_path

_CHECKSUM = "sha256"


def _checksum(tensors: Mapping[str, torch.Tensor], about: str) -> str:
    digest = hashlib.sha256(about.encode())
    for name in sorted(tensors):
        tensor = tensors[name]
        digest.update(f"{name}{tensor.dtype}{tuple(tensor.shape)}".encode())
        digest.update(tensor.reshape(-1).view(torch.uint8).numpy().data)
    return digest.hexdigest()


def write_tensors(path: Path | str, tensors: Mapping[str, torch.Tensor], *, about: object = None) -> None:
    """Write named tensors and, in the same file, `about` as JSON; atomically.

    One file for both: tensors and the text that belongs to them can never be of two different moments.
    """
    # Copies on the CPU: safetensors refuses tensors that share memory or are not contiguous.
    plain = {
        name: tensor.detach().cpu().clone(memory_format=torch.contiguous_format) for name, tensor in tensors.items()
    }
    text = json.dumps(about)
    with atomic_path(path) as temporary:
        # Written here and not by safetensors, for ordinary permissions and an ordinary error when the disk is full.
        temporary.write_bytes(save(plain, metadata={"about": text, _CHECKSUM: _checksum(plain, text)}))


def read_tensors(path: Path | str) -> tuple[dict[str, torch.Tensor], object]:
    """Read what `write_tensors` wrote: the tensors, on the CPU, and `about`.

    Raises:
        InputError: absent, truncated, altered or not written by `write_tensors`.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(str(path), expected="a safetensors file", got="no such file", fix="check the folder")
    try:
        with safe_open(str(path), framework="pt", device="cpu") as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (not a mapping)
    except (SafetensorError, OSError, ValueError) as error:
        raise InputError(
            str(path), expected="a complete safetensors file", got=f"a damaged one ({error})",
            fix="copy or train the model again",
        ) from error
    text = metadata.get("about", "null")
    if metadata.get(_CHECKSUM) != _checksum(tensors, text):
        raise InputError(
            str(path), expected="contents that match their checksum", got="altered or foreign contents",
            fix="copy or train the model again",
        )
    return tensors, json.loads(text)
