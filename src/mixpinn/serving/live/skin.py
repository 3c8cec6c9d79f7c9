"""SkinPlacement: from a place on the skin, where a pointer hits it, to the pose of a probe that presses there."""

from typing import Literal

import numpy as np

from mixpinn.base.arrays import AnyArray, FloatArray
from mixpinn.base.errors import InputError
from mixpinn.geometry.probe_pose import PROBE_AXIS, ProbePose, probe_rotation
from mixpinn.geometry.rotations import rotation_from_vector
from mixpinn.press.model import PoseModel

Axis = Literal["pressing", "normal"]
_SMOOTH = 15.0
"""A normal of the skin is the mean over the skin within this distance [mm]: triangles alone would make a probe jerk."""


class SkinPlacement:
    """Places probes on the skin of a pose model."""

    def __init__(self, model: PoseModel) -> None:
        """Prepare for the mesh of `model`."""
        mesh = model.hybrid.mesh
        corners = mesh.points[mesh.skin_faces]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        self._model, self._centres, self._across = model, corners.mean(axis=1), across
        self._direction = np.array(model.domain.direction)

    def normal(self, point: AnyArray) -> FloatArray:
        """Outward unit normal of the resting skin around a place [mm], shape (3,)."""
        distance = np.linalg.norm(self._centres - np.asarray(point, dtype=np.float64), axis=1)
        reach = max(_SMOOTH, 1.5 * float(distance.min()))
        weight = np.maximum(0.0, 1.0 - (distance / reach) ** 2)
        normal = weight @ self._across
        return np.asarray(normal / np.linalg.norm(normal), dtype=np.float64)

    def rotation(
        self, point: AnyArray, *, axis: Axis = "pressing", turn_deg: float = 0.0,
        tilt_deg: tuple[float, float] = (0.0, 0.0),
    ) -> FloatArray:
        """How a probe at a place is turned, shape (3, 3).

        R = R_z(t₂) R_x(t₁) A R_y(θ): the turn θ about its own axis, A from −y to the axis, then the tilts about the
        world's x and z.

        Args:
            point: place on the skin [mm], shape (3,).
            axis: ``pressing``: along the mean pressing direction that was learned from; ``normal``: into the skin.
            turn_deg: θ [degree].
            tilt_deg: t₁ and t₂ [degree].
        """
        direction = self._direction if axis == "pressing" else -self.normal(point)
        about_x = rotation_from_vector(np.array([np.deg2rad(tilt_deg[0]), 0.0, 0.0]))
        about_z = rotation_from_vector(np.array([0.0, 0.0, np.deg2rad(tilt_deg[1])]))
        return np.asarray(about_z @ about_x @ probe_rotation(turn_deg, direction), dtype=np.float64)

    def place(
        self, point: AnyArray, *, depth: float, axis: Axis = "pressing", turn_deg: float = 0.0,
        tilt_deg: tuple[float, float] = (0.0, 0.0), probe: int = 0,
    ) -> ProbePose:
        """The pose of a probe whose axis goes through a place on the skin, resting or deformed.

        Args:
            point: the place [mm], shape (3,).
            depth: how far beyond first touch of the resting skin, along its axis [mm]; negative: above it.
            axis, turn_deg, tilt_deg: as in `rotation`.
            probe: which of the model's probes.

        Raises:
            InputError: values that are not finite, or no skin in the probe's way that the bundle was prepared for.
        """
        place = np.asarray(point, dtype=np.float64)
        numbers = (*place.ravel(), depth, turn_deg, *tilt_deg)
        if place.shape != (3,) or not np.isfinite(numbers).all():
            raise InputError(
                "place on the skin", expected="finite x, y, z [mm], depth [mm] and angles [degree]", got=str(numbers),
                fix="check the pointer",
            )
        rotation = self.rotation(place, axis=axis, turn_deg=turn_deg, tilt_deg=tilt_deg)
        field = self._model.probes[probe]
        beyond = float(self._model.contact.depth([field], rotation[None], place[None])[0])
        if not np.isfinite(beyond):
            raise InputError(
                "place on the skin", expected="skin of the back that the bundle was prepared for",
                got=f"{np.round(place, 1).tolist()}, where none lies in the probe's way", fix="point at the back",
            )
        return ProbePose(rotation, place + (depth - beyond) * (rotation @ PROBE_AXIS))
