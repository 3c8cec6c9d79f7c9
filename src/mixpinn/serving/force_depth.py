"""From a force that is wanted to the depth of a probe that feels it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mixpinn.base.arrays import AnyArray, FloatArray
from mixpinn.base.errors import InputError, SolveError
from mixpinn.geometry.probe_pose import PROBE_AXIS, probe_rotation
from mixpinn.records.answer import Answer

if TYPE_CHECKING:
    from mixpinn.serving.hybrid_predictor import HybridPredictor

_MOST_SOLVES = 8
_FIRST, _POWER = 0.5, 1.25
"""First guess: this part of the learned depth; force grows as this power of the depth until more is known."""


@dataclass(frozen=True, eq=False)
class DepthForForce:
    """A pose whose force is the one that was wanted.

    Attributes:
        depth: beyond first touch of the resting skin, along the axis [mm].
        tip: where the tip is then, world [mm], shape (3,).
        rotation: of the probe, shape (3, 3).
        force: size of the force there [N].
        answer: the whole answer there.
        solves: how many poses were solved for it.
    """

    depth: float
    tip: FloatArray
    rotation: FloatArray
    force: float
    answer: Answer
    solves: int


def depth_for(
    predictor: "HybridPredictor", force: float, tip: AnyArray | Sequence[float], *, rotation_deg: float = 0.0,
    direction: Sequence[float] = (0.0, -1.0, 0.0), rotation: AnyArray | None = None, tolerance: float = 0.1,
) -> DepthForForce:
    """Press along a line until the size of the force is `force`.

    The force F(d) is zero at first touch and grows with the depth d somewhat faster than linearly. What is known of it
    is interpolated in log d over log F: by a power law from one answer, by the straight line through two, and by the
    parabola through three; the depth stays between those whose forces enclose the wanted one.

    Args:
        predictor: a hybrid model that takes poses.
        force: that is wanted [N].
        tip: a place on the line along which the probe presses [mm], shape (3,).
        rotation_deg, direction, rotation: of the probe, as in `HybridPredictor.press`.
        tolerance: by how much the force may be off [N].

    Raises:
        InputError: a force that is not positive or beyond what the pose reaches within the depth that was learned from,
            or no skin in the probe's way.
        SolveError: the force does not come within the tolerance.
    """
    model = predictor.pressing
    place = np.asarray(tip, dtype=np.float64)
    turn = probe_rotation(rotation_deg, direction) if rotation is None else np.asarray(rotation, dtype=np.float64)
    beyond = float(model.contact.depth([model.probes[0]], turn.reshape(1, 3, 3), place.reshape(1, 3))[0])
    if not np.isfinite(beyond):
        raise InputError(
            "tip", expected="skin in the probe's way", got=f"none at {np.round(place, 1).tolist()}",
            fix="move it over the back",
        )
    if not (np.isfinite(force) and force > 0.0 and tolerance > 0.0):
        raise InputError("force", expected="more than 0 N", got=f"{force:g} N", fix="give the size of the force")
    deepest, axis = model.domain.deepest, turn @ PROBE_AXIS
    known: dict[float, float] = {}
    depth = _FIRST * deepest
    for solves in range(1, _MOST_SOLVES + 1):
        where = place + (depth - beyond) * axis
        answer = predictor.press(where, rotation=turn)
        assert answer.force is not None
        known[depth] = float(np.linalg.norm(answer.force))
        if abs(known[depth] - force) <= tolerance:
            return DepthForForce(depth, where, turn, known[depth], answer, solves)
        if depth >= deepest and known[depth] < force:
            raise InputError(
                "force", expected=f"0 to {known[depth]:.1f} N, what this pose reaches within the learned "
                f"{deepest:.1f} mm", got=f"{force:g} N", fix="ask for less, or choose another place",
            )
        depth = _next_depth(known, force, deepest)
    raise SolveError(
        f"depth for {force:g} N: after {_MOST_SOLVES} poses the nearest force is "
        f"{min(known.values(), key=lambda value: abs(value - force)):.2f} N"
    )


def _next_depth(known: dict[float, float], force: float, deepest: float) -> float:
    """Where the force is likely to be the wanted one, at most `deepest` [mm]."""
    felt = {depth: size for depth, size in known.items() if size > 0.0}
    low = max((depth for depth, size in known.items() if size < force), default=0.0)
    high = min((depth for depth, size in known.items() if size >= force), default=deepest)
    if not felt:
        return deepest if low >= 0.5 * deepest else 0.5 * (low + deepest)
    nearest = sorted(felt, key=lambda depth: abs(np.log(felt[depth] / force)))[:3]
    x = np.array([np.log(felt[depth] / force) for depth in nearest])
    y = np.log(nearest)
    if len(nearest) == 1:
        guess = y[0] - x[0] / _POWER
    elif len(nearest) == 2 or np.abs(np.diff(np.sort(x))).min() < 1e-6:
        guess = y[0] - x[0] * (y[1] - y[0]) / (x[1] - x[0]) if abs(x[1] - x[0]) > 1e-9 else y[0]
    else:
        weights = [
            np.prod([x[j] / (x[j] - x[i]) for j in range(3) if j != i]) for i in range(3)
        ]  # Lagrange's polynomial at x = 0
        guess = float(np.dot(weights, y))
    found = float(np.exp(guess))
    # A force beyond all that is known: the deepest pose tells whether it can be reached at all.
    if high == deepest and deepest not in known:
        return found if found < 0.97 * deepest else deepest
    return found if low < found < high else 0.5 * (low + high)
