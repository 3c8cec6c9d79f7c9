"""The two counters that watch the validation loss: plateau decay of the learning rate, and the early stop."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

from mixpinn.training.config import TrainConfig, TrainingSettings


@dataclass(frozen=True)
class Schedule:
    """Where the learning rate and the counters stand after some epochs.

    An epoch improves where its validation loss is lower than every earlier one. "The learning rate is decayed by a
    factor of 0.1 to a minimum value of 1e-8 when the validation loss does not improve in 5 epochs"; training stops
    if it "did not decrease after 15 epochs" (MIXPINN, implementation details). Decay restarts its own count, so that
    a lasting plateau decays every `decay_patience` epochs; the count of the early stop continues.

    Attributes:
        learning_rate: to be used in the next epoch.
        best_loss: lowest validation loss so far.
        epochs_on_plateau: epochs without improvement since the last one that improved or the last decay.
        epochs_since_best: epochs without improvement since the last one that improved.
        improved: whether the last epoch improved.
    """

    learning_rate: float
    best_loss: float = math.inf
    epochs_on_plateau: int = 0
    epochs_since_best: int = 0
    improved: bool = False

    @staticmethod
    def start(config: TrainingSettings) -> "Schedule":
        """The schedule before the first epoch."""
        return Schedule(config.learning_rate)

    def after(self, validation_loss: float, config: TrainConfig) -> "Schedule":
        """The schedule after one more epoch; a loss that is not a number counts as no improvement."""
        if validation_loss < self.best_loss:
            return Schedule(self.learning_rate, validation_loss, improved=True)
        plateau, learning_rate = self.epochs_on_plateau + 1, self.learning_rate
        if plateau >= config.decay_patience:
            plateau, learning_rate = 0, max(learning_rate * config.decay_factor, config.min_learning_rate)
        return replace(
            self, learning_rate=learning_rate, epochs_on_plateau=plateau,
            epochs_since_best=self.epochs_since_best + 1, improved=False,
        )

    def replay(self, validation_losses: Iterable[float], config: TrainConfig) -> "Schedule":
        """The schedule after several epochs: what a resumed run continues with."""
        schedule = self
        for loss in validation_losses:
            schedule = schedule.after(loss, config)
        return schedule

    def exhausted(self, config: TrainConfig) -> bool:
        """Whether the early stop is due."""
        return self.epochs_since_best >= config.stop_patience
