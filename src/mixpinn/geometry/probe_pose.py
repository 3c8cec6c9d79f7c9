"""Where a probe stands and how it is turned: its own axis, rotations about it, and the placement of its surface."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mixpinn.base.arrays import AnyArray, FloatArray
from mixpinn.geometry.rotations import rotation_about_y, rotation_from_vector, skew, vector_from_rotation

PROBE_AXIS = np.array([0.0, -1.0, 0.0])
"""The direction in which a probe points and presses, in its own frame."""

PATH_STEP = 1.0
"""Every answer to a pose, solved in full or predicted, follows its path in steps of this length [mm]."""


@dataclass(frozen=True, eq=False)
class ProbePose:
    """Rigid placement of a probe.

    Attributes:
        rotation: from the probe's frame to the world, shape (3, 3).
        translation: position of the tip [mm], shape (3,).
    """

    rotation: FloatArray
    translation: FloatArray

    @property
    def axis(self) -> FloatArray:
        """Unit vector along which the probe presses, shape (3,)."""
        return self.rotation @ PROBE_AXIS

    def place(self, points: FloatArray) -> FloatArray:
        """World positions of points of the probe's frame, shape (p, 3) [mm]."""
        return points @ self.rotation.T + self.translation

    def local(self, points: FloatArray) -> FloatArray:
        """Points of the world in the probe's frame, shape (p, 3) [mm]."""
        found: FloatArray = (points - self.translation) @ self.rotation
        return found

    def towards(self, other: "ProbePose", fraction: float) -> "ProbePose":
        """The pose at `fraction` of the screw-free motion to `other`."""
        turn = vector_from_rotation(other.rotation @ self.rotation.T)
        return ProbePose(
            rotation_from_vector(fraction * turn) @ self.rotation,
            (1.0 - fraction) * self.translation + fraction * other.translation,
        )


def probe_rotation(
    rotation_deg: AnyArray | float, direction: Sequence[float] | FloatArray = (0.0, -1.0, 0.0),
) -> FloatArray:
    """Rotation matrices that turn the probe about its axis and then point it along `direction`.

    R = A · R_y(θ), with R_y the right-handed rotation about +y and A the shortest turn from −y to `direction`. Close
    to +y, where the shortest turn is ill-defined, A is half a turn about z and then the shortest one from +y.

    Args:
        rotation_deg: θ [degree], one or several, shape (...).
        direction: along which the probe presses, of any length, shape (3,).

    Returns:
        Shape (..., 3, 3).
    """
    about_axis = rotation_about_y(rotation_deg)
    target = np.asarray(direction, dtype=np.float64)
    target = np.asarray(target / np.linalg.norm(target), dtype=np.float64)
    if float(PROBE_AXIS @ target) < -0.99:
        return _shortest_turn(-PROBE_AXIS, target) @ np.diag([-1.0, -1.0, 1.0]) @ about_axis
    return _shortest_turn(PROBE_AXIS, target) @ about_axis


def _shortest_turn(start: FloatArray, end: FloatArray) -> FloatArray:
    """Rodrigues: I + [v] + [v]² / (1 + c) with v = start × end and c = start · end > −1, unit vectors."""
    cross = skew(np.cross(start, end))
    turn: FloatArray = np.eye(3) + cross + cross @ cross / (1.0 + float(start @ end))
    return turn
