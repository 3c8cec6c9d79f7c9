"""From an answer to the messages that say it: which device, which type, in RAS."""

import json
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mixpinn.records import TissueMesh
from mixpinn.records.answer import Answer
from mixpinn.server.igtl.devices import FORCE, GRID, SKIN, TRUST, part_devices
from mixpinn.server.igtl.grid import DisplacementGrid
from mixpinn.server.igtl.message import Message
from mixpinn.server.igtl.ndarray import NdarrayBody
from mixpinn.server.igtl.ras import RasFrame
from mixpinn.server.igtl.skin import SkinSurface
from mixpinn.server.igtl.string import StringBody
from mixpinn.server.igtl.transform import TransformBody
from mixpinn.serving.motions import centroids, motion_matrices


@dataclass(frozen=True)
class Frame:
    """One answer and what it answers.

    Attributes:
        answer: of the predictor; None before the first pose: everything is at rest.
        timestamp: of the pose, as it came; every message about the answer carries it.
        number: counts answers; version 2 of the protocol carries it as the message's number.
    """

    answer: Answer | None
    timestamp: int = 0
    number: int = 0


class Publisher:
    """Makes messages of answers; each type is made only where somebody takes it."""

    def __init__(
        self, mesh: TissueMesh, *, skin_points: int | None = None, spacing: float = 10.0, version: int = 1,
    ) -> None:
        """Prepare what stays the same from answer to answer.

        Args:
            mesh: that the answers are about.
            skin_points: send the skin at about so many points; None at all of them.
            spacing: of the grid of displacements [mm]; it is found when the grid is first asked for.
            version: of the messages' header, 1 or 2.

        Raises:
            InputError: too few points, a spacing that is not positive, or names that the protocol cannot hold.
        """
        self.frame = RasFrame.of_mesh(mesh)
        self.devices = part_devices(mesh.rigid_names)
        self._mesh, self._spacing, self._version = mesh, spacing, version
        self._skin = SkinSurface(mesh, self.frame, most_points=skin_points)
        self._centres = centroids(mesh)
        self._grid: DisplacementGrid | None = None
        self._makers: dict[str, Callable[[Frame], list[tuple[str, bytes]]]] = {
            "TRANSFORM": self._transforms, "NDARRAY": self._force, "STRING": self._trust, "POLYDATA": self._surface,
            "IMAGE": self._image,
        }

    @property
    def kinds(self) -> tuple[str, ...]:
        """Types that can be asked for, the most urgent first."""
        return tuple(self._makers)

    def messages(self, kind: str, frame: Frame) -> list[Message]:
        """The messages of one type about a frame, a device each."""
        return [
            Message(kind, device, content, frame.timestamp, self._version, frame.number)
            for device, content in self._makers[kind](frame)
        ]

    def _transforms(self, frame: Frame) -> list[tuple[str, bytes]]:
        motions = {} if frame.answer is None else frame.answer.motions
        matrices = self.frame.motion(motion_matrices(self._mesh, motions, centres=self._centres))
        return [
            (device, TransformBody(matrix).pack())
            for device, matrix in zip(self.devices.values(), matrices, strict=True)
        ]

    def _force(self, frame: Frame) -> list[tuple[str, bytes]]:
        """A row a probe: force [N] and moment about the tip [N mm] of the tissue on it, in RAS."""
        answer = frame.answer
        rows = np.zeros((1, 6))
        if answer is not None and answer.force is not None and answer.moment is not None and np.size(answer.force):
            parts = [self.frame.vectors(np.atleast_2d(part)) for part in (answer.force, answer.moment)]
            rows = np.concatenate(parts, axis=1)
        return [(FORCE, NdarrayBody(rows).pack())]

    def _trust(self, frame: Frame) -> list[tuple[str, bytes]]:
        """JSON, so that a program can read it and a person too."""
        answer = frame.answer
        trust = None if answer is None else answer.trust
        said: dict[str, object] = {"pose": frame.number}
        if answer is not None and answer.force is not None:
            said["force_N"] = [round(float(np.linalg.norm(row)), 3) for row in np.atleast_2d(answer.force)]
        if trust is not None:
            said |= {
                "sound": trust.sound, "outside": trust.outside, "converged": trust.converged,
                "expected_error_mm": _short(trust.expected), "bound_mm": _short(trust.bound), "level": trust.level,
                "force_bound_N": _short(trust.force_bound), "motion_bound_mm": _short(trust.motion_bound),
                "reasons": list(trust.reasons),
            }
        if answer is not None and answer.total is not None:
            said["converged_error"] = {"force": _short(answer.total.force), "motion": _short(answer.total.motion)}
        return [(TRUST, StringBody(json.dumps(said)).pack())]

    def prepare_grid(self) -> None:
        """Find the grid's voxels in the body, which takes a second or more; done once."""
        if self._grid is None:
            self._grid = DisplacementGrid(self._mesh, self.frame, spacing=self._spacing)

    @property
    def grid_ready(self) -> bool:
        """Whether `prepare_grid` has been called."""
        return self._grid is not None

    def _surface(self, frame: Frame) -> list[tuple[str, bytes]]:
        moved = np.zeros((self._mesh.n_points, 3)) if frame.answer is None else frame.answer.displacement
        return [(SKIN, self._skin.content(moved))]

    def _image(self, frame: Frame) -> list[tuple[str, bytes]]:
        self.prepare_grid()
        assert self._grid is not None
        if frame.answer is None:
            body = self._grid.image(np.zeros((self._mesh.n_points, 3)), {})
        else:
            body = self._grid.image(frame.answer.displacement, frame.answer.motions)
        return [(GRID, body.pack())]


def _short(value: float | None) -> float | None:
    return None if value is None else round(value, 4)
