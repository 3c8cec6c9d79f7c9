"""Evaluation: the metrics of one model on one split, sample by sample."""

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mixpinn.base.arrays import FloatArray
from mixpinn.base.files import read_json, write_json


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
        write_json(path, asdict(self))

    @staticmethod
    def load(path: Path | str) -> "Evaluation":
        """Read what `save` wrote."""
        values = read_json(path)
        for name in ("metrics", "about", "by_part"):
            values[name] = {key: np.array(item, dtype=np.float64) for key, item in values[name].items()}
        values["seconds"] = np.array(values["seconds"], dtype=np.float64)
        return Evaluation(**values)
