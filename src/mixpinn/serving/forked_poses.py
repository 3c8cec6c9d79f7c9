"""Many poses shared among processes forked from this one.

Between its compiled kernels a prediction runs Python, a fifth of its time, where threads of one process wait for each
other. A forked process has the loaded model already and shares its memory; what it finds comes back through a pipe.
"""

import multiprocessing
import os
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from typing import TYPE_CHECKING, NamedTuple

from mixpinn.base.arrays import FloatArray
from mixpinn.base.child_process import end_with_parent
from mixpinn.base.errors import InputError

if TYPE_CHECKING:
    from mixpinn.press.model import PoseModel, PosePrediction
    from mixpinn.press.records import ContactHistory

FEWEST = 16
"""Poses a process below which it is not worth its start."""
_TOGETHER = 4


class _Work(NamedTuple):
    model: "PoseModel"
    tips: FloatArray
    rotations: FloatArray
    history: "ContactHistory | None"


_work: _Work | None = None
"""Of a forked process, set when it begins and never changed; None in the process that was started by the user."""


def may_fork(count: int, workers: int) -> bool:
    """Whether `count` poses are worth `workers` processes, and forking is safe.

    A process is not forked while other threads run, as these may hold locks that nobody would release in the copy.
    """
    alone = threading.active_count() == 1 and not multiprocessing.current_process().daemon
    return sys.platform.startswith("linux") and alone and workers > 1 and count >= FEWEST * workers


def predict_forked(
    model: "PoseModel", tips: FloatArray, rotations: FloatArray, *, history: "ContactHistory | None", workers: int,
) -> "list[PosePrediction]":
    """What follows from each of m poses of the first probe, in their order.

    Args:
        model: of contact from the pose.
        tips: of each [mm], shape (m, 3).
        rotations: of each, shape (m, 3, 3).
        history: from which each goes on.
        workers: how many processes.

    Raises:
        InputError: a pose that is refused; it is named by its number.
        BrokenProcessPool: a process was ended from outside.
    """
    pool = ProcessPoolExecutor(
        workers, mp_context=multiprocessing.get_context("fork"), initializer=_begin,
        initargs=(os.getpid(), _Work(model, tips, rotations, history)),
    )
    with pool:
        return list(pool.map(_predict, range(len(tips)), chunksize=_TOGETHER))


def _begin(parent: int, work: _Work) -> None:
    global _work
    end_with_parent(parent)
    _work = work


def _predict(index: int) -> "PosePrediction":
    assert _work is not None
    model, tips, rotations, history = _work
    with named(index):
        return model.predict(rotations[index][None], tips[index][None], probes=[0], history=history)


@contextmanager
def named(index: int) -> Iterator[None]:
    """An error that comes from inside says which pose it is about."""
    try:
        yield
    except InputError as error:
        what = f"pose {index}: {error.what}"
        raise InputError(what, expected=error.expected, got=error.got, fix=error.fix) from error
