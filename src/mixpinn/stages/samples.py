"""The samples of a store and how they are divided: what every fit and every evaluation begins with."""

from dataclasses import dataclass

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
from mixpinn.records import SampleTable

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
