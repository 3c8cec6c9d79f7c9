"""Evaluation: the metrics of one model on one split, sample by sample."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mixpinn.base.arrays import FloatArray
from mixpinn.base.validated import ArraySpec, load_record, save_record


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Metrics of one model.

    Attributes:
        model: name of the model.
        split: name of the split.
        metrics: metric name to its value for each sample, each shape (N,). In mm, MSE in mm².
        about: for each sample what identifies it, each shape (N,): ``position``, ``rotation``, ``depth``.
        by_part: rigid part name (or ``soft``) to MEE for each sample [mm], each shape (N,).
        seconds: wall time of one prediction [s], shape (N,) or empty.
        notes: protocol, contact-node rule, training length and whatever else a reader must know.
    """

    model: str
    split: str
    metrics: dict[str, FloatArray]
    about: dict[str, FloatArray]
    by_part: dict[str, FloatArray]
    seconds: FloatArray
    notes: dict[str, Any] = field(default_factory=dict)

    def save(self, path: Path | str) -> None:
        """Write as JSON."""
        save_record(path, self)

    @staticmethod
    def load(path: Path | str) -> "Evaluation":
        """Read what `save` wrote.

        Raises:
            InputError: absent, damaged, or values of different numbers of samples.
        """
        values = load_record(_Plain, path, remake=_REMAKE, finite=False)
        extents: dict[str, int] = {}
        groups: dict[str, dict[str, FloatArray]] = {}
        for name in ("metrics", "about", "by_part"):
            arrays = {key: np.array(item, dtype=np.float64) for key, item in getattr(values, name).items()}
            for key, array in arrays.items():
                where = f"{path}: {name}.{key}"
                ArraySpec("number", ("samples",), finite=False).check(array, where, extents=extents, remake=_REMAKE)
            groups[name] = arrays
        seconds = np.array(values.seconds, dtype=np.float64)
        return Evaluation(
            values.model, values.split, groups["metrics"], groups["about"], groups["by_part"], seconds, values.notes,
        )


@dataclass(frozen=True)
class _Plain:
    """What an evaluation is in JSON."""

    model: str
    split: str
    metrics: dict[str, list[float]]
    about: dict[str, list[float]]
    by_part: dict[str, list[float]]
    seconds: list[float]
    notes: dict[str, Any] = field(default_factory=dict)


_REMAKE = "delete it and evaluate again"
