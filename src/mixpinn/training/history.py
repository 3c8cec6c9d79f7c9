"""The loss curve: one row an epoch, and the outcome of a run."""

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import Literal

from mixpinn.base.errors import InputError
from mixpinn.base.files import write_text
from mixpinn.networks.checkpoint import NETWORK

HISTORY_FILE = "history.csv"
_REMAKE = "delete the folder and train again"

StopReason = Literal["early stop", "epoch limit", "time budget"]


@dataclass(frozen=True)
class EpochRecord:
    """One epoch.

    Attributes:
        epoch: counted from 1.
        train_loss: mean of the loss over the training samples while the weights moved [mm].
        validation_loss: mean of the loss over the validation samples at the end of the epoch [mm].
        learning_rate: that the epoch used.
        seconds: wall time of the epoch, validation included [s].
    """

    epoch: int
    train_loss: float
    validation_loss: float
    learning_rate: float
    seconds: float


@dataclass(frozen=True)
class TrainingResult:
    """Outcome of a training run.

    Attributes:
        folder: the model folder: weights of the best epoch, their description, the mesh, the logs.
        history: one record an epoch.
        best_epoch: the epoch with the lowest validation loss, counted from 1.
        best_validation_loss: its validation loss [mm].
        seconds: wall time of all epochs [s].
        stopped_by: why training ended.
    """

    folder: Path
    history: tuple[EpochRecord, ...]
    best_epoch: int
    best_validation_loss: float
    seconds: float
    stopped_by: StopReason


def write_history(folder: Path | str, history: Sequence[EpochRecord]) -> None:
    """Write ``history.csv``, atomically; floats in the shortest form that reads back to the same bits.

    The manifest of the network in `folder`, where there is one, lists it from then on.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([field.name for field in fields(EpochRecord)])
    writer.writerows(astuple(record) for record in history)
    write_text(Path(folder) / HISTORY_FILE, text.getvalue())
    if NETWORK.is_sealed(folder):
        NETWORK.seal_more(folder, [HISTORY_FILE])


def check_history(folder: Path | str) -> None:
    """Compare ``history.csv`` with the manifest beside it; one that no manifest lists is of an older version.

    Raises:
        InputError: it was altered.
    """
    if NETWORK.is_sealed(folder) and NETWORK.lists(folder, HISTORY_FILE):
        NETWORK.check(folder, HISTORY_FILE)


def read_history(folder: Path | str) -> tuple[EpochRecord, ...]:
    """Read the ``history.csv`` of a run.

    Raises:
        InputError: absent, damaged or altered.
    """
    path = Path(folder) / HISTORY_FILE
    check_history(folder)
    try:
        with path.open(newline="") as file:
            records = tuple(
                EpochRecord(int(row["epoch"]), *(float(row[field.name]) for field in fields(EpochRecord)[1:]))
                for row in csv.DictReader(file)
            )
    except FileNotFoundError as error:
        raise InputError(
            str(path), expected="the history of a training run", got="no such file", fix="check the folder",
        ) from error
    except (KeyError, TypeError, ValueError, csv.Error) as error:
        raise InputError(
            str(path), expected="one row of numbers an epoch", got=f"{type(error).__name__}: {error}",
            fix=_REMAKE,
        ) from error
    for number, record in enumerate(records, start=1):
        if record.epoch < 1 or not all(map(math.isfinite, astuple(record))):
            raise InputError(
                f"{path}: row {number}", expected="an epoch from 1 on and finite numbers",
                got=str(astuple(record)), fix=_REMAKE,
            )
    return records
