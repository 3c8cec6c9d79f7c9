"""The settings of a training run, with the paper's values as defaults: as a user gives them and as a run reads them."""

from dataclasses import dataclass, fields
from typing import Literal

from mixpinn.base.errors import InputError
from mixpinn.networks.config import ModelConfig


@dataclass(frozen=True)
class TrainConfig:
    """Settings of the optimizer, its schedule and the run.

    Attributes:
        learning_rate: of AdamW at the start; None: the model's own.
        weight_decay: of AdamW.
        decay_factor: the learning rate is multiplied by it on a plateau of the validation loss.
        decay_patience: epochs without improvement that make a plateau.
        min_learning_rate: the learning rate is never lowered below it.
        stop_patience: epochs without improvement after which training stops.
        batch_size: samples an optimizer step, over all devices together; None: the model's own.
        max_epochs: training stops after this many epochs at the latest.
        seed: decides the initial weights, the order of the samples and dropout.
        precision: ``bfloat16`` is automatic mixed precision for GPUs; the weights stay in float32.
        threads: CPU threads; None leaves them as they are.
        time_budget: training stops after the epoch that exceeds it [s]; None means no limit. Counted over the epochs
            of all sessions of an interrupted run.
    """

    learning_rate: float | None = None
    weight_decay: float = 0.01
    decay_factor: float = 0.1
    decay_patience: int = 5
    min_learning_rate: float = 1e-8
    stop_patience: int = 15
    batch_size: int | None = None
    max_epochs: int = 200
    seed: int = 0
    precision: Literal["float32", "bfloat16"] = "float32"
    threads: int | None = None
    time_budget: float | None = None

    def __post_init__(self) -> None:
        for name in ("decay_patience", "stop_patience", "max_epochs"):
            self._require(name, getattr(self, name) >= 1, "at least 1")
        self._require("batch_size", self.batch_size is None or self.batch_size >= 1, "at least 1")
        self._require("learning_rate", self.learning_rate is None or self.learning_rate > 0.0, "a positive number")
        self._require("weight_decay", self.weight_decay >= 0.0, "zero or a positive number")
        self._require("decay_factor", 0.0 < self.decay_factor < 1.0, "a number between 0 and 1")
        self._require("min_learning_rate", self.min_learning_rate >= 0.0, "zero or a positive number")
        self._require(
            "min_learning_rate", self.learning_rate is None or self.min_learning_rate <= self.learning_rate,
            "at most the learning rate",
        )
        self._require("seed", self.seed >= 0, "zero or a positive integer")
        self._require("threads", self.threads is None or self.threads >= 1, "at least 1")
        self._require("time_budget", self.time_budget is None or self.time_budget > 0.0, "a positive number of seconds")

    def for_model(self, model: ModelConfig) -> "TrainingSettings":
        """The settings with which `model` is trained: what is None becomes the model's own.

        Raises:
            InputError: the smallest learning rate is above the model's own.
        """
        own = PHYSGNN_TRAINING if model.architecture == "physgnn" else PAPER_TRAINING
        given = {field.name: getattr(self, field.name) for field in fields(TrainConfig)}
        for name in ("learning_rate", "batch_size"):
            if given[name] is None:
                given[name] = getattr(own, name)
        return TrainingSettings(**given)

    def _require(self, name: str, holds: bool, expected: str) -> None:
        if not holds:
            raise InputError(name, expected=expected, got=repr(getattr(self, name)), fix="correct the setting")


@dataclass(frozen=True)
class TrainingSettings(TrainConfig):
    """A `TrainConfig` whose numbers are all known: what the training loop reads and ``run.json`` records.

    Attributes:
        learning_rate: of AdamW at the start.
        batch_size: samples an optimizer step, over all devices together.
    """

    learning_rate: float = 5e-4
    batch_size: int = 4


PAPER_TRAINING = TrainingSettings()
"""Training of MIXPINN and the simple GAT in the paper."""

PHYSGNN_TRAINING = TrainingSettings(learning_rate=5e-3, batch_size=8)
"""Training of the PhysGNN baseline."""
