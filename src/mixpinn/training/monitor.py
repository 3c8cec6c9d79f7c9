"""What one sees of a run while it lasts: a progress bar with time left, and TensorBoard's curves."""

from contextlib import AbstractContextManager
from pathlib import Path
from types import TracebackType

from rich.progress import Progress

from mixpinn.base.progress import progress_bar
from mixpinn.records import SampleTable
from mixpinn.training.batches import batch_count
from mixpinn.training.config import TrainingSettings
from mixpinn.training.history import EpochRecord


class EpochLog(AbstractContextManager["EpochLog"]):
    """TensorBoard's log in ``tensorboard/`` of the run; epochs that are repeated replace their earlier points."""

    def __init__(self, folder: Path, *, first_epoch: int) -> None:
        # Imported here: it takes a second, and only the leading process writes.
        from torch.utils.tensorboard import SummaryWriter

        self._writer = SummaryWriter(str(folder / "tensorboard"), purge_step=first_epoch)

    def add(self, record: EpochRecord) -> None:
        """Log one epoch."""
        self._writer.add_scalar("loss/train", record.train_loss, record.epoch)
        self._writer.add_scalar("loss/validation", record.validation_loss, record.epoch)
        self._writer.add_scalar("learning_rate", record.learning_rate, record.epoch)
        self._writer.flush()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None,
    ) -> None:
        self._writer.close()


class TrainingProgress(AbstractContextManager["TrainingProgress"]):
    """Two bars with time left: the run up to its epoch limit, and the epoch."""

    def __init__(self, table: SampleTable, config: TrainingSettings, epochs_done: int, *, visible: bool) -> None:
        self._per_epoch, self._max_epochs = batch_count(len(table), config.batch_size), config.max_epochs
        self._bar: Progress = progress_bar() if visible else Progress(disable=True)
        self._run = self._bar.add_task(
            "training", total=self._per_epoch * config.max_epochs, completed=self._per_epoch * epochs_done,
        )
        self._epoch = self._bar.add_task("epoch", total=self._per_epoch)

    def __enter__(self) -> "TrainingProgress":
        self._bar.start()
        return self

    def start_epoch(self, epoch: int, best_loss: float) -> None:
        """Begin the bar of an epoch."""
        self._bar.update(self._run, description=f"training, best validation loss {best_loss:.4g} mm")
        self._bar.reset(self._epoch, total=self._per_epoch, description=f"epoch {epoch} of at most {self._max_epochs}")

    def advance(self) -> None:
        """Count one batch."""
        self._bar.advance(self._run)
        self._bar.advance(self._epoch)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None,
    ) -> None:
        self._bar.stop()
