"""Fit whichever model a name says, hybrid or network, on a store of simulations."""

from collections.abc import Sequence
from pathlib import Path

from mixpinn.dataset import SimulationStore, Split
from mixpinn.fem import Material
from mixpinn.records import SampleTable
from mixpinn.reduced.hybrid import HybridModel
from mixpinn.stages.hybrid import HybridStageConfig, make_hybrid
from mixpinn.stages.training import HYBRID, ModelsConfig, train_model
from mixpinn.training import TrainingResult


def fit_model(
    store: SimulationStore, table: SampleTable, split: Split, name: str, config: ModelsConfig, *, out: Path | str,
    materials: Sequence[Material] | None = None, devices: int = 1, held_out: str | None = None,
) -> HybridModel | TrainingResult:
    """Fit one model in the run directory `out`; an interrupted run continues.

    Args:
        store: the simulations.
        table: their samples.
        split: of their positions.
        name: ``hybrid``, or a network of the paper's tables.
        config: width, scaling, optimizer; modes and regression of the hybrid model.
        out: run directory.
        materials: one for each tissue, where the store cannot tell them: a class of one's own.
        devices: processes of a network's training, each with a device of its own.
        held_out: a hold-out by name whose samples training and validation do not see.

    Raises:
        InputError: an unknown name, or `out` holds another run.
    """
    if name != HYBRID:
        return train_model(store, table, split, name, config, out=out, devices=devices, held_out=held_out)
    settings = HybridStageConfig(hybrid=config.hybrid)
    return make_hybrid(store, table, split, settings, out=out, materials=materials, held_out=held_out)
