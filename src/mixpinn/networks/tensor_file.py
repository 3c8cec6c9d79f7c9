"""Torch tensors in the files of `mixpinn.base.tensor_file`: state dicts of networks and optimizers."""

from collections.abc import Mapping
from pathlib import Path

import torch

from mixpinn.base.tensor_file import read_arrays, write_arrays


def write_tensors(path: Path | str, tensors: Mapping[str, torch.Tensor], *, about: object = None) -> None:
    """Write named tensors of any device; format and errors are those of `write_arrays`."""
    write_arrays(path, {name: tensor.detach().cpu().numpy() for name, tensor in tensors.items()}, about=about)


def read_tensors(path: Path | str) -> tuple[dict[str, torch.Tensor], object]:
    """Read what `write_tensors` or `write_arrays` wrote: the tensors, on the CPU, and `about`.

    Raises:
        InputError: absent, truncated, altered or of another writer.
    """
    arrays, about = read_arrays(path)
    return {name: torch.from_numpy(array) for name, array in arrays.items()}, about
