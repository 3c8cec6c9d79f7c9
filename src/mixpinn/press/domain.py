"""PoseDomain: which poses of a probe a model has learned from, and what to say of one that lies outside."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from mixpinn.base.arrays import AnyArray, FloatArray
from mixpinn.base.errors import InputError
from mixpinn.geometry.probe_pose import PROBE_AXIS
from mixpinn.records import TissueMesh

_MORE_DEPTH = 0.5
"""Beyond the deepest pose learned from, poses count as inside by this much [mm]."""
_MORE_TILT = 15.5
"""Beyond the largest tilt learned from, poses count as inside by this much [degree]."""
_BESIDE = 10.0
"""Beside the rigid parts and the poses learned from, poses count as inside by this much [mm]."""
_NO_SENSE_DEPTH, _NO_SENSE_MORE, _NO_SENSE_TILT = 1.5, 10.0, 45.0
"""Poses deeper by this factor and by this much [mm], or tilted by this much more [degree], are refused."""
_FAR = 30.0
"""A probe that is farther than this from first touch is not near the skin [mm]."""


@dataclass(frozen=True)
class PoseDomain:
    """Poses inside of what was learned.

    Attributes:
        deepest: way beyond first touch [mm].
        direction: mean pressing direction, of length 1.
        tilt_deg: largest angle from it [degree].
        low, high: bounds of the tip along two axes across the direction [mm].
        learned_low, learned_high: bounds of the tips that were learned from, which may leave out an end of the bones.
    """

    deepest: float
    direction: tuple[float, float, float]
    tilt_deg: float
    low: tuple[float, float]
    high: tuple[float, float]
    learned_low: tuple[float, float] | None = None
    learned_high: tuple[float, float] | None = None

    @staticmethod
    def of_mesh(mesh: TissueMesh, *, deepest: float = 20.0) -> "PoseDomain":
        """Straight presses along −y over the rigid parts, down to `deepest` [mm]."""
        direction = PROBE_AXIS
        low, high = _extent(mesh, direction)
        return PoseDomain(deepest, _three(direction), 0.0, _two(low), _two(high))

    @staticmethod
    def of_samples(
        mesh: TissueMesh, rotations: FloatArray, translations: FloatArray, depths: FloatArray,
    ) -> "PoseDomain":
        """The poses of s samples.

        Args:
            mesh: whose rigid parts are pressed.
            rotations, translations: of the probe, shapes (s, 3, 3) and (s, 3) [mm].
            depths: beyond first touch [mm], shape (s,).
        """
        axes = rotations @ PROBE_AXIS
        direction = axes.mean(axis=0)
        direction = direction / np.linalg.norm(direction)
        tilt = np.rad2deg(np.arccos(np.clip(axes @ direction, -1.0, 1.0))).max()
        low, high = _extent(mesh, direction)
        places = translations @ across_axes(direction).T
        return PoseDomain(
            float(depths.max()), _three(direction), float(tilt), _two(np.minimum(low, places.min(axis=0))),
            _two(np.maximum(high, places.max(axis=0))), _two(places.min(axis=0)), _two(places.max(axis=0)),
        )

    def beyond(self, translations: FloatArray) -> float:
        """How far the outermost of k tips (k, 3) lies outside of all that were learned from, across the direction [mm].

        Zero where that is not known.
        """
        if self.learned_low is None or self.learned_high is None:
            return 0.0
        places = translations @ across_axes(np.array(self.direction)).T
        outside = np.maximum(np.array(self.learned_low) - places, places - np.array(self.learned_high))
        return float(np.linalg.norm(np.maximum(outside, 0.0), axis=1).max(initial=0.0))

    def refuse_nonsense(self, rotations: FloatArray, depths: FloatArray) -> None:
        """Stop before a pose is solved that no answer could be given for.

        Args:
            rotations: of the probes, shape (k, 3, 3).
            depths: beyond first touch [mm], shape (k,).

        Raises:
            InputError: a probe that presses from another side, or stands far beyond what was learned.
        """
        tilt, limit = self._tilt(rotations).max(), self.tilt_deg + _NO_SENSE_TILT
        if tilt > limit:
            raise InputError(
                "pose", expected=f"a probe that presses within {limit:.0f}° of {np.round(self.direction, 2)}",
                got=f"one at {tilt:.0f}° to it", fix="check rotation and frame: a probe presses along its own −y",
            )
        deepest = float(depths.max())
        limit = max(_NO_SENSE_DEPTH * self.deepest, self.deepest + _NO_SENSE_MORE)
        if deepest > limit:
            raise InputError(
                "pose", expected=f"a probe up to {limit:.0f} mm beyond first touch",
                got=f"one {deepest:.0f} mm beyond it, inside or beneath the body", fix="check the tip and the frame",
            )

    def reasons(self, rotations: FloatArray, translations: FloatArray, depths: FloatArray) -> tuple[str, ...]:
        """Why the poses of k probes lie outside, in words; empty where they do not."""
        found = []
        deepest, tilt = float(depths.max()), self._tilt(rotations).max()
        if deepest > self.deepest + _MORE_DEPTH:
            found.append(f"{deepest:.1f} mm beyond first touch; poses up to {self.deepest:.1f} mm were learned from")
        if tilt > self.tilt_deg + _MORE_TILT:
            found.append(f"tilted by {tilt:.0f}°; poses up to {self.tilt_deg + _MORE_TILT:.0f}° count as known")
        places = translations @ across_axes(np.array(self.direction)).T
        beside = np.maximum(np.array(self.low) - places, places - np.array(self.high)).max()
        if beside > _BESIDE:
            found.append(f"{beside:.0f} mm beside the rigid parts and the poses learned from")
        if deepest < -_FAR:
            found.append("far from the skin")
        return tuple(found)

    def _tilt(self, rotations: FloatArray) -> FloatArray:
        cosine = np.clip(rotations @ PROBE_AXIS @ np.array(self.direction), -1.0, 1.0)
        angle: FloatArray = np.rad2deg(np.arccos(cosine))
        return angle

    def as_dict(self) -> dict[str, Any]:
        """Plain values."""
        return asdict(self)


def across_axes(direction: FloatArray) -> FloatArray:
    """Two unit vectors across a unit vector, shape (2, 3)."""
    first = np.eye(3)[np.abs(direction).argmin()]
    first = first - (first @ direction) * direction
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(direction, first)])


def _extent(mesh: TissueMesh, direction: FloatArray) -> tuple[FloatArray, FloatArray]:
    points = mesh.pressed_points @ across_axes(direction).T
    return points.min(axis=0), points.max(axis=0)


def _two(values: AnyArray) -> tuple[float, float]:
    return float(values[0]), float(values[1])


def _three(values: AnyArray) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])
