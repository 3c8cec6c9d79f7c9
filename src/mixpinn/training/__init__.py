"""The training loop."""

from mixpinn.training.arithmetic import settle_arithmetic
from mixpinn.training.batches import Batch, batches, contact_fields
from mixpinn.training.config import PAPER_TRAINING, PHYSGNN_TRAINING, TrainConfig, TrainingSettings
from mixpinn.training.history import EpochRecord, TrainingResult, read_history
from mixpinn.training.loop import train
from mixpinn.training.schedule import Schedule

__all__ = [
    "PAPER_TRAINING",
    "PHYSGNN_TRAINING",
    "Batch",
    "EpochRecord",
    "Schedule",
    "TrainConfig",
    "TrainingResult",
    "TrainingSettings",
    "batches",
    "contact_fields",
    "read_history",
    "settle_arithmetic",
    "train",
]
