"""The training stage: a store of simulations in, one model folder a named model out."""

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from mixpinn.base.errors import InputError
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
from mixpinn.records import SampleTable
from mixpinn.reduced.fit import HybridConfig
from mixpinn.stages.network_training import train_stage
from mixpinn.training import PHYSGNN_TRAINING, TrainConfig, TrainingResult

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
        train: optimizer and schedule; PhysGNN takes the learning rate and batch size of its authors unless they
            differ from the defaults here.
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

    def training(self, name: str) -> TrainConfig:
        """Training settings of the model `name`."""
        if MODELS[name].architecture != "physgnn":
            return self.train
        default, own = TrainConfig(), PHYSGNN_TRAINING
        return replace(
            self.train,
            learning_rate=(
                own.learning_rate if self.train.learning_rate == default.learning_rate else self.train.learning_rate
            ),
            batch_size=own.batch_size if self.train.batch_size == default.batch_size else self.train.batch_size,
        )


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
    name: str, config: ModelsConfig, table: SampleTable, split: Split, store: SimulationStore, *, out: Path | str,
    devices: int = 1, held_out: str | None = None,
) -> TrainingResult:
    """Train one model in the run directory `out`; an interrupted run continues.

    Args:
        name: of the model.
        config: width, scaling, optimizer.
        table: the samples.
        split: of their positions.
        store: the simulations.
        out: run directory.
        devices: processes, each with a device of its own.
        held_out: a hold-out by name whose samples training and validation do not see.
    """
    samples = choose_samples(table, split, held_out)
    return train_stage(
        out, config.model(name), config.training(name), mesh=store.mesh(),
        table_train=table.select(samples.train), table_validation=table.select(samples.validation),
        inputs={"store": store.folder / "store.json"}, devices=devices,
    )
