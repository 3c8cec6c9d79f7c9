"""TrainingJob: everything that a training run is made from, checked and identified."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mixpinn.base.errors import InputError
from mixpinn.base.files import hash_arrays
from mixpinn.networks import ModelConfig
from mixpinn.records import SampleTable, TissueMesh
from mixpinn.records.answer import discretisation_of
from mixpinn.training.config import TrainingSettings
from mixpinn.training.history import EpochRecord, StopReason

LIMITS = ("max_epochs", "time_budget", "threads")
"""Settings that say how long and where a run continues, not what it computes: a resumed run may change them."""


@dataclass(frozen=True, eq=False)
class TrainingJob:
    """What each process of a run needs.

    Attributes:
        model_config: the network.
        config: optimizer, schedule, limits.
        mesh: the mesh of the samples.
        table_train: training samples.
        table_validation: validation samples.
        folder: model folder to write.

    Raises:
        InputError: samples of another mesh, or none.
    """

    model_config: ModelConfig
    config: TrainingSettings
    mesh: TissueMesh
    table_train: SampleTable
    table_validation: SampleTable
    folder: Path

    def __post_init__(self) -> None:
        mesh_hash = self.mesh.hash()
        for name, table in (("training samples", self.table_train), ("validation samples", self.table_validation)):
            if table.mesh_hash != mesh_hash:
                raise InputError(
                    name, expected=f"samples of {discretisation_of(self.mesh)}", got=f"those of {table.made_on}",
                    fix="train on the mesh that was simulated",
                )
            if len(table) == 0:
                raise InputError(name, expected="at least one sample", got="none", fix="simulate more positions")

    @property
    def settings(self) -> dict[str, Any]:
        """Configuration of network and training without the limits, as JSON gives it back."""
        training = {name: value for name, value in asdict(self.config).items() if name not in LIMITS}
        settings: dict[str, Any] = json.loads(json.dumps({"model": asdict(self.model_config), "training": training}))
        return settings

    @property
    def input_hashes(self) -> dict[str, str]:
        """Identity of mesh and samples."""
        return {
            "mesh": self.mesh.hash(), "training samples": table_hash(self.table_train),
            "validation samples": table_hash(self.table_validation),
        }

    def identity(self) -> dict[str, Any]:
        """All that decides the loss curve."""
        return {**self.settings, "inputs": self.input_hashes}

    def summary(self, history: Sequence[EpochRecord], stopped_by: StopReason | None = None) -> dict[str, Any]:
        """What a reader of the model wants to know of its training; `stopped_by` is None while it runs."""
        best = min(history, key=lambda record: record.validation_loss)
        return {
            "settings": asdict(self.config), "samples": len(self.table_train),
            "validation_samples": len(self.table_validation), "epochs": len(history),
            "seconds": sum(record.seconds for record in history), "best_epoch": best.epoch,
            "best_train_loss": best.train_loss, "best_validation_loss": best.validation_loss, "stopped_by": stopped_by,
        }


def table_hash(table: SampleTable) -> str:
    """Identity of a table: what its samples are, and the displacement of up to 64 of them, evenly spread."""
    some = np.unique(np.linspace(0, len(table) - 1, 64).astype(np.int64))
    return hash_arrays(
        table.position_index, table.rotation_deg, table.depth, table.contact_offsets, table.contact_nodes,
        np.asarray(table.displacement[some]),
    )
