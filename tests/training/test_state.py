"""The state of a run: round trip of weights and moments, refusal of what is not this run's."""

from pathlib import Path

import pytest
import torch
from torch import nn

from mixpinn.base.errors import InputError
from mixpinn.training import EpochRecord
from mixpinn.training.state import STATE_FILE, epoch_seed, load_state, save_state

HISTORY = [EpochRecord(1, 0.1, 1 / 3, 5e-4, 2.5)]


def step(module: nn.Module, optimizer: torch.optim.Optimizer) -> None:
    """One optimizer step on fixed data."""
    optimizer.zero_grad()
    module(torch.linspace(-1.0, 1.0, 12).view(4, 3)).square().mean().backward()
    optimizer.step()


def network(seed: int) -> tuple[nn.Module, torch.optim.Optimizer]:
    """A small network with its optimizer."""
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        module = nn.Sequential(nn.Linear(3, 4), nn.BatchNorm1d(4), nn.Linear(4, 2))
    return module, torch.optim.AdamW(module.parameters(), lr=0.1)


def test_a_loaded_state_goes_on_bit_for_bit(tmp_path: Path) -> None:
    module, optimizer = network(0)
    step(module, optimizer)
    save_state(tmp_path, module, optimizer, HISTORY, identity={"run": 1})
    loaded, loaded_optimizer = network(1)
    assert load_state(tmp_path, loaded, loaded_optimizer, identity={"run": 1}) == HISTORY
    for _ in range(3):
        step(module, optimizer)
        step(loaded, loaded_optimizer)
    for name, value in module.state_dict().items():
        assert torch.equal(value, loaded.state_dict()[name])


def test_no_state_means_no_history(tmp_path: Path) -> None:
    assert load_state(tmp_path, *network(0), identity={}) == []


def test_another_run_and_a_damaged_state_are_refused(tmp_path: Path) -> None:
    module, optimizer = network(0)
    step(module, optimizer)
    save_state(tmp_path, module, optimizer, HISTORY, identity={"run": 1})
    with pytest.raises(InputError, match="another model, mesh or setting"):
        load_state(tmp_path, module, optimizer, identity={"run": 2})
    wider = nn.Linear(7, 7)
    with pytest.raises(InputError, match="this version's network"):
        load_state(tmp_path, wider, torch.optim.AdamW(wider.parameters()), identity={"run": 1})
    path = tmp_path / STATE_FILE
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(InputError, match="complete safetensors"):
        load_state(tmp_path, module, optimizer, identity={"run": 1})


def test_seeds_differ_by_run_epoch_and_stream() -> None:
    seeds = [epoch_seed(0, 0), epoch_seed(0, 1), epoch_seed(1, 0), epoch_seed(0, 1, 0), epoch_seed(0, 1, 1),
             epoch_seed(0, 1, 1, 1)]
    assert len(set(seeds)) == len(seeds)
    assert seeds[0] == epoch_seed(0, 0)
    assert all(0 <= seed < 2**63 for seed in seeds)
