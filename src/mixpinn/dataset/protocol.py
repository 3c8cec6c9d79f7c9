"""Protocol: where the probe presses, at which rotations, and along which path."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from mixpinn.base.arrays import FloatArray
from mixpinn.base.errors import InputError
from mixpinn.base.sensible import require_settings
from mixpinn.base.text_table import read_columns
from mixpinn.geometry.probe_pose import probe_rotation
from mixpinn.records import ProbePath

_MOST_STEPS, _LEAST_SPACING = 10_000, 0.1
"""Steps of one pose, and distance between positions [mm]; beyond them a setting is taken for a slip."""


@dataclass(frozen=True)
class Protocol:
    """Which poses are simulated and how deep.

    Step s = 1 … `steps` has the depth d = s · `step` − `approach` [mm], at which the tip lies at
    ``origin + (d − lag) · direction``. The origin is the listed position (`start` ``listed``), or the place where
    the tip stands when the probe first comes within the contact gap of the skin (`start` ``touch``), so that
    depth 1 mm is the first step that indents.

    SOFA's collision mesh trails its rigid body by one step: the fields that it stores for depth d were computed
    with the probe at depth d − 1 mm. `lag` 1 mm replays exactly that; 0 puts the probe where the depth says.

    Attributes:
        rotations: rotations of the probe about the pressing direction [degree].
        approach: height above the origin from which the probe starts [mm].
        step: depth increment [mm].
        steps: number of steps a pose, approach included.
        start: what the origin of the path is.
        direction: pressing direction in the world frame, of any length.
        lag: how far the probe trails behind the depth [mm].
        spacing: distance between neighbouring positions where they are laid out as a grid [mm].
        max_positions: at most so many positions, spread evenly; None keeps all.
    """

    rotations: tuple[float, ...] = (0.0, 45.0, 90.0, 135.0)
    approach: float = 8.0
    step: float = 1.0
    steps: int = 28
    start: Literal["listed", "touch"] = "listed"
    direction: tuple[float, float, float] = (0.0, -1.0, 0.0)
    lag: float = 0.0
    spacing: float = 10.0
    max_positions: int | None = None

    def __post_init__(self) -> None:
        require_settings(self, "protocol", {
            "rotations": (
                0 < len(self.rotations) == len({angle % 360.0 for angle in self.rotations})
                and max(map(abs, self.rotations)) <= 360.0, "distinct angles from −360° to 360°",
            ),
            "approach": (0.0 <= self.approach < np.inf, "0 mm or more"),
            "lag": (abs(self.lag) < np.inf, "a length"),
            "step": (0.0 < self.step < np.inf, "a positive length"),
            "steps": (1 <= self.steps <= _MOST_STEPS, f"at least 1, at most {_MOST_STEPS:,}"),
            "spacing": (_LEAST_SPACING <= self.spacing < np.inf, f"at least {_LEAST_SPACING:g} mm"),
            "direction": (float(np.linalg.norm(self.direction)) > 1e-9, "a vector that is not zero"),
            "max_positions": (self.max_positions is None or self.max_positions >= 1, "at least 1"),
        })

    @property
    def unit_direction(self) -> FloatArray:
        """Pressing direction of length 1, shape (3,)."""
        direction = np.asarray(self.direction, dtype=np.float64)
        return np.asarray(direction / np.linalg.norm(direction), dtype=np.float64)

    @property
    def depths(self) -> FloatArray:
        """Depth of each step [mm], shape (steps,)."""
        return np.arange(1, self.steps + 1, dtype=np.float64) * self.step - self.approach


PAPER = Protocol()
"""The paper's protocol: four rotations, from 8 mm above the listed position to 20 mm below it."""

SOFA_REPLAY = Protocol(lag=1.0)
"""The paper's protocol with the probe where SOFA's collision mesh was."""

ANATOMY = Protocol(approach=0.0, steps=20, start="touch")
"""Any anatomy: four rotations, twenty steps of 1 mm from first touch."""

SMALL = Protocol(rotations=(0.0,), approach=0.0, steps=10, start="touch", max_positions=24)
"""One rotation at 24 positions, ten steps of 1 mm."""

TINY = Protocol(rotations=(0.0, 90.0), approach=0.0, step=1.5, steps=3, start="touch", spacing=20.0, max_positions=4)
"""Four positions, two rotations, three steps of 1.5 mm: for trying things out."""

_POSITION = {axis: (f"{axis}_mm", f"tip_{axis}", f"position_{axis}", f"pos_{axis}") for axis in "xyz"}
"""What the columns of a list of positions may be called."""

PROTOCOLS = {"paper": PAPER, "sofa-replay": SOFA_REPLAY, "anatomy": ANATOMY, "small": SMALL, "tiny": TINY}


@dataclass(frozen=True)
class Pose:
    """One simulation: the probe at one position with one rotation.

    Attributes:
        position_index: index into the list of positions.
        position: origin of the path [mm]: the tip at depth 0.
        rotation_deg: rotation about the pressing direction [degree].
    """

    position_index: int
    position: tuple[float, float, float]
    rotation_deg: float

    @property
    def name(self) -> str:
        """``pose_PPP_RRR``: position index and rotation, with a decimal part only where there is one."""
        angle = self.rotation_deg % 360.0
        whole = abs(angle - round(angle)) < 1e-9
        return f"pose_{self.position_index:03d}_" + (f"{round(angle):03d}" if whole else f"{angle:07.3f}")


def list_poses(positions: FloatArray, protocol: Protocol) -> tuple[Pose, ...]:
    """All rotations of the protocol at each of `positions` [mm], shape (p, 3), positions first."""
    return tuple(
        Pose(index, (float(x), float(y), float(z)), float(rotation))
        for index, (x, y, z) in enumerate(positions) for rotation in protocol.rotations
    )


def probe_path(position: Sequence[float] | FloatArray, rotation_deg: float, protocol: Protocol) -> ProbePath:
    """Path of the probe over all steps of `protocol`.

    Args:
        position: origin of the path, the tip at depth 0 (and no lag) [mm], shape (3,).
        rotation_deg: rotation about the pressing direction [degree].
        protocol: depths, direction and lag.

    Example:
        >>> path = probe_path((0.0, 134.0, 0.0), 45.0, PAPER)
        >>> float(path.translations[0, 1]), float(path.depths[-1]), float(path.translations[-1, 1])
        (141.0, 20.0, 114.0)
    """
    depths = protocol.depths
    origin = np.asarray(position, dtype=np.float64)
    translations = origin + (depths - protocol.lag)[:, None] * protocol.unit_direction
    rotation = probe_rotation(rotation_deg, protocol.unit_direction)
    return ProbePath(translations, np.tile(rotation, (len(depths), 1, 1)), depths)


def read_positions(path: Path | str) -> FloatArray:
    """Read probe positions from a table with the columns x, y and z [mm] (see `read_columns`), shape (p, 3).

    Without a line of names each row is ``x y z``; ``#`` begins a comment.

    Raises:
        InputError: absent, not numbers, not three a line, or not finite.
    """
    fix = "write one 'x y z' in mm a line"
    positions = read_columns(path, _POSITION, unit="mm", expected="a list of probe positions", fix=fix)
    if not np.isfinite(positions).all():
        raise InputError(str(path), expected="three finite numbers a line", got="NaN or infinity", fix=fix)
    return positions
