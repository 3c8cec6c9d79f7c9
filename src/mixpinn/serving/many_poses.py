"""Many poses at once: each is answered as `HybridPredictor.press` would, by several processes or threads."""

import contextlib
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import TYPE_CHECKING

import numpy as np

from mixpinn.base.arrays import AnyArray
from mixpinn.base.errors import InputError
from mixpinn.geometry.probe_pose import probe_rotation
from mixpinn.records.answer import Answer
from mixpinn.serving.contact_input import checked_history
from mixpinn.serving.forked_poses import may_fork, named, predict_forked

if TYPE_CHECKING:
    from mixpinn.serving.hybrid_predictor import HybridPredictor


def press_many(
    predictor: "HybridPredictor", tips: AnyArray | Sequence[Sequence[float]], *, rotation_deg: AnyArray | float = 0.0,
    direction: Sequence[float] = (0.0, -1.0, 0.0), rotations: AnyArray | None = None,
    history: object | None = None, threads: int | None = None,
) -> list[Answer]:
    """The answers to many poses of one probe, in their order.

    Many poses are shared among forked processes where that is safe (on Linux, while no other thread runs), others among
    threads: kernels run outside of Python's lock. Each pose is computed as it would be alone, and the answers do not
    depend on who computes them.

    Args:
        predictor: a hybrid model that takes poses.
        tips: where the tip ends in each, world [mm], shape (m, 3).
        rotation_deg: about the pressing direction [degree], one for all or shape (m,).
        direction: where it presses to, shape (3,).
        rotations: rotation matrices instead of these two, shape (m, 3, 3), or (3, 3) for all.
        history: of an earlier answer, from which each goes on.
        threads: how many, and no processes; None takes every core.

    Raises:
        InputError: poses of another shape, or one that `press` refuses; it is named by its number.
    """
    places = np.asarray(tips, dtype=np.float64)
    if places.ndim != 2 or places.shape[1] != 3:
        raise InputError(
            "tips", expected="one place x, y, z [mm] a pose, shape (m, 3)", got=f"shape {places.shape}",
            fix="use press for a single pose",
        )
    count = len(places)
    if rotations is None:
        rotations = probe_rotation(np.broadcast_to(rotation_deg, count), direction)
    turns = np.asarray(rotations, dtype=np.float64)
    if turns.shape not in ((3, 3), (count, 3, 3)):
        raise InputError(
            "rotations", expected=f"shape ({count}, 3, 3)", got=f"shape {turns.shape}", fix="give one for each tip",
        )
    turns = np.broadcast_to(turns, (count, 3, 3))

    workers = min(threads or len(os.sched_getaffinity(0)), max(count, 1))
    if threads is None and may_fork(count, workers):
        model, begin = predictor.pressing, checked_history(history)
        with contextlib.suppress(BrokenProcessPool):  # ended from outside, for want of memory perhaps: threads go on
            found = predict_forked(model, places, turns, history=begin, workers=workers)
            return [predictor.answer_of(each, alone=True) for each in found]

    def answer(index: int) -> Answer:
        with named(index):
            return predictor.press(places[index], rotation=turns[index], history=history)

    if workers == 1:
        return [answer(index) for index in range(count)]
    with ThreadPoolExecutor(workers, thread_name_prefix="mixpinn-poses") as pool:
        return list(pool.map(answer, range(count)))
