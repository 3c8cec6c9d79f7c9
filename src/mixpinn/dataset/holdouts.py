"""Hold-outs: what a model has never seen, as selections of samples."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from mixpinn.base.arrays import BoolArray, IntArray
from mixpinn.base.errors import InputError
from mixpinn.dataset.split import Split
from mixpinn.records import SampleTable

Selector = Callable[[SampleTable], BoolArray]
"""Says for each sample of a table whether it is held out, shape (N,)."""


@dataclass(frozen=True, eq=False)
class SampleSplit:
    """Disjoint sets of sample indices into one table.

    Attributes:
        name: for tables.
        train, validation, test: shapes (t,), (v,), (w,).
    """

    name: str
    train: IntArray
    validation: IntArray
    test: IntArray

    @property
    def parts(self) -> dict[str, IntArray]:
        """The three sets by name."""
        return {"train": self.train, "validation": self.validation, "test": self.test}


def rotation_is(rotation_deg: float) -> Selector:
    """Samples with one rotation of the probe [degree]."""
    return lambda table: np.isclose(table.rotation_deg, rotation_deg)


def deeper_than(depth: float) -> Selector:
    """Samples with more than `depth` [mm] of indentation."""
    return lambda table: table.depth > depth


def beyond(axis: int, value: float, *, sign: int = 1) -> Selector:
    """Samples whose probe tip lies beyond `value` [mm] along world axis 0, 1 or 2 (or below it, for `sign` −1)."""
    return lambda table: sign * (table.probe_translation[:, axis] - value) > 0.0


def lateral_to(distance: float) -> Selector:
    """Samples whose probe tip lies more than `distance` [mm] from the sagittal plane x = 0."""
    return lambda table: np.abs(table.probe_translation[:, 0]) > distance


HOLD_OUTS: dict[str, Selector] = {
    "rotation-45": rotation_is(45.0),
    "rotation-135": rotation_is(135.0),
    "deep": deeper_than(15.0),
    "lateral": lateral_to(35.0),
    "caudal": beyond(2, 25.0),
}
"""Named hold-outs: a rotation never seen, depths beyond 15 mm, the flanks, the caudal end."""

NOISE = "noise"
"""Name of the hold-out whose contact displacement is told with an error: nothing is left out of training."""
NOISE_MM = 0.2
"""Standard deviation of that error, each component of each contact node [mm]."""

HOLD_OUT_NAMES = (*HOLD_OUTS, NOISE)
"""Every hold-out that a command knows by name."""


def with_contact_noise(table: SampleTable, *, deviation: float = NOISE_MM, seed: int = 0) -> SampleTable:
    """The same samples, of which a model is told each contact displacement with a normal error.

    The error of a component has mean zero and standard deviation `deviation` [mm], independent for every component of
    every contact node of every sample, drawn from ``numpy.random.default_rng(seed)`` in the order of the samples. The
    reference displacement stays the true one.
    """
    error = np.random.default_rng(seed).normal(0.0, deviation, (len(table.contact_nodes), 3))
    return replace(table, contact_error=error)


def held_out_samples(table: SampleTable, samples: SampleSplit) -> SampleTable:
    """The test samples of a hold-out by name, noise included where its name says so."""
    test = table.select(samples.test)
    return with_contact_noise(test) if samples.name.rpartition("/")[2] == NOISE else test


def split_samples(table: SampleTable, split: Split) -> SampleSplit:
    """Samples at the positions of each part of `split`."""
    train, validation, test = (
        np.flatnonzero(np.isin(table.position_index, part)) for part in split.parts.values()
    )
    return SampleSplit(split.name, train, validation, test)


def hold_out(
    table: SampleTable, split: Split, *, name: str, held: Selector | None = None, unseen_positions: bool = True,
) -> SampleSplit:
    """Train and validate without the held samples, test on them.

    Args:
        table: the data set.
        split: its split by position.
        name: of one of `HOLD_OUT_NAMES`, or any where `held` is given.
        held: what is held out.
        unseen_positions: test at the split's test positions only, so that position and held property are both
            new; False tests at every position (needed where the hold-out is itself a region).

    Raises:
        InputError: an unknown name, or nothing left to train or to test on.
    """
    if name == NOISE and held is None:
        whole = split_samples(table, split)
        return replace(whole, name=f"{split.name}/{NOISE}")
    selector = held or HOLD_OUTS.get(name)
    if selector is None:
        raise InputError(
            f"hold-out {name!r}", expected="one of " + ", ".join(HOLD_OUT_NAMES), got=name, fix="check the spelling",
        )
    mask = selector(table)
    by_position = split_samples(table, split)
    tested = by_position.test if unseen_positions else np.arange(len(table))
    parts = (
        by_position.train[~mask[by_position.train]], by_position.validation[~mask[by_position.validation]],
        tested[mask[tested]],
    )
    for part, samples in zip(("training", "test"), (parts[0], parts[2]), strict=True):
        if not len(samples):
            raise InputError(
                f"hold-out {name!r}", expected=f"at least one {part} sample", got="none",
                fix="choose another hold-out or simulate more poses",
            )
    return SampleSplit(f"{split.name}/{name}", *parts)
