"""Tensors in array files: what torch holds comes back as it was, other memory layouts and gradients included."""

from pathlib import Path

import torch

from mixpinn.networks import read_tensors, write_tensors


def test_round_trip_of_a_state(tmp_path: Path) -> None:
    network = torch.nn.Sequential(torch.nn.Linear(3, 4), torch.nn.BatchNorm1d(4))
    state = {**network.state_dict(keep_vars=True), "turned": torch.arange(6.0).view(2, 3).T}
    write_tensors(tmp_path / "state.safetensors", state, about=[1])
    read, about = read_tensors(tmp_path / "state.safetensors")
    assert about == [1]
    assert read.keys() == state.keys()
    for name, tensor in state.items():
        assert read[name].dtype == tensor.dtype
        assert torch.equal(read[name], tensor)
        assert not read[name].requires_grad
