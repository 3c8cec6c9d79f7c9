"""How force and moment on a probe change with its pose."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from mixpinn.base.arrays import AnyArray, FloatArray
from mixpinn.base.errors import SolveError
from mixpinn.geometry.probe_pose import probe_rotation
from mixpinn.geometry.rotations import rotation_from_vector
from mixpinn.serving.many_poses import press_many

if TYPE_CHECKING:
    from mixpinn.serving.hybrid_predictor import HybridPredictor

SHIFT, TURN = 0.02, 0.001
"""Half the distance between the poses whose answers are compared [mm] and [rad]."""


def stiffness(
    predictor: "HybridPredictor", tip: AnyArray | Sequence[float], *, rotation_deg: float = 0.0,
    direction: Sequence[float] = (0.0, -1.0, 0.0), rotation: AnyArray | None = None, history: object | None = None,
    threads: int | None = None,
) -> FloatArray:
    """The derivative of the wrench by the pose, by central differences of twelve answers, shape (6, 6).

    Rows: force of the tissue on the probe [N], moment about its tip [N mm]. Columns: shift of the tip along the world's
    x, y, z [mm], turns about the world's axes through the tip [rad]: entry (i, j) is ∂w_i / ∂ξ_j for the pose
    (exp([ω]) R, t + d), ξ = (d, ω). Units: N/mm, N/rad, N, N mm/rad. Where contact switches (a point touches, or begins
    to slide) the answers have a kink, and the derivative is the mean over ±0.02 mm and ±0.001 rad.

    Without a history each of the twelve probes comes straight along its own axis, so that a shift across the axis
    moves the place that is pressed. With the history of an answer at this pose they all go on from there: skin that
    sticks is dragged along, which is what a robot feels that moves a little.

    Args:
        predictor: a hybrid model that takes poses.
        tip: of the probe, world [mm], shape (3,).
        rotation_deg, direction, rotation: of the probe, as in `HybridPredictor.press`.
        history: of an earlier answer.
        threads: how many; None takes every core.

    Raises:
        InputError: as `HybridPredictor.press`.
        SolveError: an answer did not converge, so that differences of it mean nothing.
    """
    place = np.asarray(tip, dtype=np.float64)
    turn = probe_rotation(rotation_deg, direction) if rotation is None else np.asarray(rotation, dtype=np.float64)
    shifts, turns = np.tile(place, (12, 1)), np.tile(turn, (12, 1, 1))
    for k in range(3):
        for side, sign in enumerate((1.0, -1.0)):
            shifts[2 * k + side, k] += sign * SHIFT
            vector = np.zeros(3)
            vector[k] = sign * TURN
            turns[6 + 2 * k + side] = rotation_from_vector(vector) @ turn
    answers = press_many(predictor, shifts, rotations=turns, history=history, threads=threads)
    unsolved = sum(answer.trust is not None and not answer.trust.converged for answer in answers)
    if unsolved:
        raise SolveError(f"stiffness: contact did not converge in {unsolved} of {len(answers)} poses around the place")
    wrench = np.array([np.concatenate([answer.force, answer.moment]) for answer in answers])
    half = np.repeat([SHIFT, TURN], 3)
    found: FloatArray = ((wrench[0::2] - wrench[1::2]) / (2.0 * half[:, None])).T
    return found
