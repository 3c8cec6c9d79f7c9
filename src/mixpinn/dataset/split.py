"""Split: which probe positions train, validate and test; all rotations of a position stay together."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from mixpinn.base.arrays import AnyArray, IntArray
from mixpinn.base.checksum import without_checksum
from mixpinn.base.errors import InputError
from mixpinn.base.files import read_json
from mixpinn.base.validated import checked_record, save_record

_Position = Annotated[int, Field(ge=0, lt=2**31)]
"""Index of a probe position."""


@dataclass(frozen=True, eq=False)
class Split:
    """Disjoint sets of probe position indices.

    Attributes:
        name: for tables.
        train, validation, test: sorted position indices, shapes (t,), (v,), (w,).

    Raises:
        InputError: a position is in two parts, or twice in one.
    """

    name: str
    train: IntArray
    validation: IntArray
    test: IntArray

    def __post_init__(self) -> None:
        for part in self.parts:
            object.__setattr__(self, part, np.sort(np.asarray(getattr(self, part), dtype=np.int64).ravel()))
        every = np.concatenate(list(self.parts.values()))
        values, counts = np.unique(every, return_counts=True)
        if (counts > 1).any() or (values < 0).any():
            wrong = values[(counts > 1) | (values < 0)]
            raise InputError(
                f"split {self.name!r}", expected="each position in one part",
                got=f"positions {wrong[:5].tolist()} in several",
                fix="make the parts disjoint",
            )

    @property
    def parts(self) -> dict[str, IntArray]:
        """The three sets by name."""
        return {"train": self.train, "validation": self.validation, "test": self.test}

    def save(self, path: Path | str) -> None:
        """Write as JSON, with a checksum."""
        save_record(path, {"name": self.name, **self.parts})

    @staticmethod
    def load(path: Path | str) -> "Split":
        """Read what `save` wrote, or a JSON with the keys ``train``, ``val`` (or ``validation``) and ``test``.

        Raises:
            InputError: absent, altered after `save`, of another layout, or parts that overlap.
        """
        remake = "write the split again"
        values = without_checksum(read_json(path), str(path), remake=remake)
        if not isinstance(values, dict):
            raise InputError(
                str(path), expected="lists of position indices 'train', 'validation' and 'test'",
                got=f"a {type(values).__name__}", fix=remake,
            )
        given = {"train": values.get("train"), "validation": values.get("validation", values.get("val")),
                 "test": values.get("test")}
        parts = checked_record(dict[str, list[_Position]], given, str(path), remake=remake)
        return Split(
            str(values.get("name", Path(path).stem)), *(np.array(part, dtype=np.int64) for part in parts.values()),
        )


def split_positions(
    n: int, *, ratios: tuple[float, float, float] = (0.7, 0.2, 0.1), seed: int = 42,
) -> Split:
    """Split n probe positions as the paper does: 132 give 93 / 26 / 13.

    The positions are permuted by ``numpy.random.default_rng(seed)``; the first train, the next validate, the last
    test. Validation and test get their share rounded down but at least one, and training gets the rest.

    Raises:
        InputError: fewer than three positions, or ratios that are not positive and of sum 1.
    """
    if n < 3:
        raise InputError("split", expected="at least 3 probe positions", got=str(n), fix="simulate more positions")
    if min(ratios) <= 0.0 or abs(sum(ratios) - 1.0) > 1e-6:
        raise InputError(
            "split ratios", expected="three positive numbers of sum 1", got=str(ratios), fix="correct them",
        )
    # 1e-9 keeps a share such as 0.1 · 30 from being rounded to the integer below it.
    validation, test = (max(1, int(np.floor(n * ratio + 1e-9))) for ratio in ratios[1:])
    validation = min(validation, n - 2)
    test = min(test, n - 1 - validation)
    order = np.random.default_rng(seed).permutation(n)
    train = n - validation - test
    return Split(f"positions-{seed}", order[:train], order[train: train + validation], order[train + validation:])


def split_sofa_subset(positions: AnyArray, *, validate: bool = False) -> Split:
    """Split the positions of a partial data set: sorted, every fifth beginning with the third tests, the rest train.

    Args:
        positions: position indices, repeats allowed, shape (n,).
        validate: set every sixth of the rest, beginning with the fourth, aside for validation.

    Raises:
        InputError: fewer than three different positions (with `validate` eight).
    """
    order = np.unique(np.asarray(positions, dtype=np.int64))
    if len(order) < (8 if validate else 3):
        raise InputError(
            "split", expected=f"at least {8 if validate else 3} probe positions", got=str(len(order)),
            fix="simulate more positions",
        )
    test = order[2::5]
    rest = np.setdiff1d(order, test)
    validation = rest[3::6] if validate else rest[:0]
    return Split("every-fifth", np.setdiff1d(rest, validation), validation, test)
