"""The training stage: the samples of a store in, one model folder out that explains itself and can be resumed."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from mixpinn.base.errors import InputError
from mixpinn.base.rundir import finish_run, run_scope, start_run
from mixpinn.dataset import (
    ContactRule,
    PoseState,
    SampleSplit,
    SimulationStore,
    Split,
    build_sample_table,
    hold_out,
    split_positions,
    split_samples,
    split_sofa_subset,
)
from mixpinn.graph import Scaling
from mixpinn.networks import MODELS, ModelConfig
from mixpinn.records import SampleTable, TissueMesh
from mixpinn.reduced.fit import HybridConfig
from mixpinn.training import TrainConfig, TrainingResult, train
from mixpinn.training.job import LIMITS, TrainingJob
from mixpinn.training.loop import Accelerator

HYBRID = "hybrid"
"""Name of the elastic prior with a learned correction."""

EVERY_FIFTH = "every-fifth"
"""Name of the split for data sets that hold only some of the listed positions."""


@dataclass(frozen=True)
class SplitConfig:
    """How the probe positions are divided.

    Attributes:
        ratios: of train, validation and test positions.
        seed: of the permutation.
        file: a split as JSON, used instead; or ``every-fifth``: of the positions that have samples, sorted, every
            fifth beginning with the third tests, and every sixth of the rest, beginning with the fourth, validates.
        contact_rule: which nodes are contact nodes: those that carry force, or all that are near.
    """

    ratios: tuple[float, float, float] = (0.7, 0.2, 0.1)
    seed: int = 42
    file: str | None = None
    contact_rule: ContactRule = "loaded"


@dataclass(frozen=True)
class ModelsConfig:
    """Which models are trained, and how.

    Attributes:
        names: ``hybrid``, or models of the paper's tables: ``mixpinn``, ``simple-gat``, ``physgnn`` or ``row-1`` …
            ``row-13``.
        width: channels a head: ``tiny``, ``desk``, ``authors`` or ``paper``.
        scaling: of inputs and outputs: ``none`` (millimetres as they are, as in the paper) or ``standard``.
        train: optimizer and schedule.
        hybrid: modes, features and regression of the hybrid model.
    """

    names: tuple[str, ...] = ("mixpinn", "simple-gat")
    width: str = "authors"
    scaling: Scaling = Scaling.NONE
    train: TrainConfig = field(default_factory=TrainConfig)
    hybrid: HybridConfig = field(default_factory=HybridConfig)

    def __post_init__(self) -> None:
        for name in self.names:
            if name != HYBRID:
                self.model(name)

    def model(self, name: str) -> ModelConfig:
        """Configuration of the model `name`.

        Raises:
            InputError: an unknown name or width.
        """
        if name not in MODELS:
            raise InputError(
                f"model {name!r}", expected="one of " + ", ".join((HYBRID, *MODELS)), got=name,
                fix="choose one of them",
            )
        return replace(MODELS[name].with_width(self.width), scaling=self.scaling)


def make_split(store: SimulationStore, config: SplitConfig) -> Split:
    """The split of the store's probe positions."""
    if config.file == EVERY_FIFTH:
        return split_sofa_subset(np.array([pose.position_index for pose in store.poses]), validate=True)
    if config.file is not None:
        return Split.load(config.file)
    return split_positions(len(store.positions), ratios=config.ratios, seed=config.seed)


def load_samples(store: SimulationStore, config: SplitConfig) -> tuple[SampleTable, Split]:
    """All samples of the store, and the split.

    Raises:
        InputError: the simulations are not finished, or a part of the split has no sample.
    """
    missing = [status for status in store.statuses() if status.state is PoseState.MISSING]
    if missing:
        raise InputError(
            str(store.folder), expected="finished simulations",
            got=f"{len(missing)} poses missing, the first {missing[0].name} ({missing[0].reason})",
            fix="run 'mixpinn simulate' again: finished poses are kept",
        )
    table, split = build_sample_table(store, contact=config.contact_rule), make_split(store, config)
    for name, positions in split.parts.items():
        if not len(table.at_positions(positions)):
            raise InputError(
                f"{name} part of the split", expected="at least one sample",
                got=f"none at its {len(positions)} positions", fix="simulate more positions or deeper",
            )
    return table, split


def choose_samples(table: SampleTable, split: Split, held_out: str | None) -> SampleSplit:
    """Samples of the split's parts, without those that the hold-out `held_out` (by name) keeps for its test.

    Raises:
        InputError: an unknown hold-out, or one that leaves nothing to train or to test on.
    """
    return split_samples(table, split) if held_out is None else hold_out(table, split, name=held_out)


def train_model(
    store: SimulationStore, table: SampleTable, split: Split, name: str, config: ModelsConfig, *, out: Path | str,
    devices: int = 1, held_out: str | None = None,
) -> TrainingResult:
    """Train one network in the run directory `out`; an interrupted run continues.

    Args:
        store: the simulations.
        table: their samples.
        split: of their positions.
        name: of the network.
        config: width, scaling, optimizer.
        out: run directory.
        devices: processes, each with a device of its own.
        held_out: a hold-out by name whose samples training and validation do not see.

    Raises:
        InputError: an unknown name, or `out` holds another run.
        SolveError: the loss is not a number any more.
    """
    samples = choose_samples(table, split, held_out)
    return train_network(
        store.mesh(), table.select(samples.train), table.select(samples.validation), config.model(name), config.train,
        out=out, inputs={"store": store.folder / "store.json"}, devices=devices,
    )


@run_scope()
def train_network(
    mesh: TissueMesh, table_train: SampleTable, table_validation: SampleTable, model: ModelConfig, config: TrainConfig,
    *, out: Path | str, inputs: Mapping[str, Path | str] | None = None, devices: int = 1,
    accelerator: Accelerator = "auto",
) -> TrainingResult:
    """Train on tables of samples in the run directory `out`, which is the model folder too; a run there continues.

    The limits (`max_epochs`, `time_budget`, `threads`) may differ between the sessions of a run: a finished one is
    extended by giving it more.

    Args:
        mesh: the mesh of the samples.
        table_train: training samples.
        table_validation: validation samples.
        model: the network.
        config: optimizer, schedule, limits; what is None becomes the network's own.
        out: run directory: ``run.json``, the model (``weights.safetensors``, ``model.json``, ``mesh.vtu``),
            ``state.safetensors``, ``history.csv`` and ``tensorboard/``.
        inputs: files that the samples came from, for the record.
        devices: processes, each with a device of its own.
        accelerator: kind of device.

    Raises:
        InputError: samples of another mesh or none, or `out` holds another run.
        SolveError: the loss is not a number any more.

    Example:
        >>> from mixpinn.networks import MIXPINN
        >>> network, settings = MIXPINN.with_width("tiny"), TrainConfig(max_epochs=1, threads=1)
        >>> learned, valid = table.at_positions([0, 1]), table.at_positions([2])
        >>> len(train_network(mesh, learned, valid, network, settings, out="runs/new").history)
        1
    """
    settings = config.for_model(model)
    job = TrainingJob(model, settings, mesh, table_train, table_validation, Path(out))
    start_run(out, "train", job.settings, inputs=inputs, seed=settings.seed, input_hashes=job.input_hashes)
    result = train(
        model, settings, mesh=mesh, table_train=table_train, table_validation=table_validation, out=out,
        devices=devices, accelerator=accelerator,
    )
    finish_run(out, {
        **{name: value for name, value in job.summary(result.history, result.stopped_by).items() if name != "settings"},
        "limits": {name: getattr(settings, name) for name in LIMITS}, "devices": devices,
    })
    return result
