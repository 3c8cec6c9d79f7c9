"""The state of a training run after an epoch: all that a resumed run needs to go on as if never interrupted."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from mixpinn.base.errors import InputError
from mixpinn.networks.tensor_file import read_tensors, write_tensors
from mixpinn.training.history import EpochRecord

STATE_FILE = "state.safetensors"
_MODEL, _OPTIMIZER = "model.", "optimizer."


def epoch_seed(seed: int, epoch: int, *stream: int) -> int:
    """Seed of an epoch's random numbers, independent for each epoch and `stream`.

    Deriving it from (seed, epoch) instead of carrying a generator's state along makes an epoch the same whether
    the run was interrupted before it or not.
    """
    # The length comes first, since SeedSequence takes trailing zeros for nothing.
    sequence = np.random.SeedSequence([len(stream), seed, epoch, *stream])
    return int(sequence.generate_state(1, np.uint64)[0] >> np.uint64(1))


def save_state(
    folder: Path | str, module: nn.Module, optimizer: torch.optim.Optimizer, history: Sequence[EpochRecord], *,
    identity: Mapping[str, Any],
) -> None:
    """Write ``state.safetensors`` atomically: weights, the optimizer's moments, the history and what run it is.

    Learning rate, plateau and early-stop counters follow from the history (`Schedule.replay`), the random numbers
    from seed and epoch (`epoch_seed`); keeping them twice would let them disagree.
    """
    tensors = {_MODEL + name: tensor for name, tensor in module.state_dict().items()}
    for index, entries in optimizer.state_dict()["state"].items():
        tensors |= {f"{_OPTIMIZER}{index}.{name}": torch.as_tensor(value) for name, value in entries.items()}
    about = {"identity": dict(identity), "history": [asdict(record) for record in history]}
    write_tensors(Path(folder) / STATE_FILE, tensors, about=about)


def load_state(
    folder: Path | str, module: nn.Module, optimizer: torch.optim.Optimizer, *, identity: Mapping[str, Any],
) -> list[EpochRecord]:
    """Put the state that `save_state` wrote into `module` and `optimizer`.

    Returns:
        the history so far; empty where no epoch has been completed.

    Raises:
        InputError: damaged, or the state of another run.
    """
    path = Path(folder) / STATE_FILE
    if not path.exists():
        return []
    tensors, about = read_tensors(path)
    if not isinstance(about, dict) or about.get("identity") != dict(identity):
        raise InputError(
            str(path), expected="the state of this run", got="the state of a run with another model, mesh or setting",
            fix="choose another output folder or delete this one",
        )
    moments: dict[int, dict[str, Tensor]] = {}
    for key, tensor in _under(tensors, _OPTIMIZER).items():
        index, _, name = key.partition(".")
        moments.setdefault(int(index), {})[name] = tensor
    try:
        module.load_state_dict(_under(tensors, _MODEL))
        optimizer.load_state_dict({"state": moments, "param_groups": optimizer.state_dict()["param_groups"]})
        return [EpochRecord(**record) for record in about["history"]]
    except (RuntimeError, ValueError, KeyError, TypeError) as error:
        raise InputError(
            str(path), expected="the state of this version's network", got=str(error).replace("\n", " "),
            fix="delete the folder and train again",
        ) from error


def _under(tensors: Mapping[str, Tensor], prefix: str) -> dict[str, Tensor]:
    return {key.removeprefix(prefix): tensor for key, tensor in tensors.items() if key.startswith(prefix)}
