"""JointFrame: where two rigid parts are joined, and along which axes."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mixpinn.base.arrays import FloatArray
from mixpinn.base.checksum import without_checksum
from mixpinn.base.errors import InputError
from mixpinn.base.files import read_json
from mixpinn.base.validated import save_record

JOINTS_FILE = "joints.json"
"""Name of the joint frames beside a mesh."""
_REMAKE = "make the joint frames again from the mesh"

Three = tuple[float, float, float]


@dataclass(frozen=True)
class JointFrame:
    """Place and axes of a joint in the rest configuration, shared by both parts.

    Of vertebrae the first is the caudal one, which a testing machine clamps; the axes point to the right, to the back
    and caudally. A turn of the second part about +x is then extension, about −x flexion.

    Attributes:
        first, second: names of the rigid parts.
        origin: centre of the joint, world frame [mm].
        axes: unit vectors x, y, z in world coordinates, one a row; right-handed.
        spacing: distance between the centres of the two bodies along the spine [mm], 0 where it has no meaning.

    Raises:
        InputError: axes that are not orthonormal and right-handed, or a part joined with itself.
    """

    first: str
    second: str
    origin: Three
    axes: tuple[Three, Three, Three]
    spacing: float = 0.0

    def __post_init__(self) -> None:
        origin, axes = np.asarray(self.origin, dtype=np.float64), np.asarray(self.axes, dtype=np.float64)
        sound = origin.shape == (3,) and axes.shape == (3, 3) and np.isfinite(origin).all() and self.spacing >= 0.0
        if not sound or not np.allclose(axes @ axes.T, np.eye(3), atol=1e-6) or np.linalg.det(axes) < 0.0:
            raise InputError(
                f"joint of {self.first} and {self.second}", expected="an origin and three right-handed unit vectors",
                got="something else", fix="give the axes as rows, each of length one",
            )
        if self.first == self.second:
            raise InputError(
                f"joint of {self.first}", expected="two parts", got="the same one twice", fix="name another part",
            )
        object.__setattr__(self, "origin", tuple(origin.tolist()))
        object.__setattr__(self, "axes", tuple(tuple(row) for row in axes.tolist()))

    @staticmethod
    def of_arrays(
        first: str, second: str, *, origin: FloatArray, axes: FloatArray, spacing: float = 0.0,
    ) -> "JointFrame":
        """A frame from its origin (3,) [mm] and axes, one a row, (3, 3); the rest as above."""
        x, y, z = np.asarray(axes, dtype=np.float64).tolist()
        return JointFrame(first, second, tuple(np.asarray(origin, dtype=np.float64).tolist()), (x, y, z), spacing)

    @property
    def centre(self) -> FloatArray:
        """Origin [mm], shape (3,)."""
        return np.array(self.origin)

    @property
    def columns(self) -> FloatArray:
        """Axes x, y, z as columns: the rotation from the joint's axes to the world's, shape (3, 3)."""
        return np.array(self.axes).T

    @property
    def name(self) -> str:
        """Both parts, as pictures and messages call the joint."""
        return f"{self.second}-{self.first}"


def save_joint_frames(frames: Sequence[JointFrame], path: Path | str) -> None:
    """Write frames as JSON, with a checksum."""
    save_record(path, {"unit": "mm", "joints": [asdict(frame) for frame in frames]})


def load_joint_frames(path: Path | str) -> tuple[JointFrame, ...]:
    """Read what `save_joint_frames` wrote; what is written by hand needs no checksum.

    Raises:
        InputError: absent, altered, not JSON, or not joint frames.
    """
    record = without_checksum(read_json(path), str(path), remake=_REMAKE)
    entries = record.get("joints") if isinstance(record, dict) else None
    if not isinstance(entries, list):
        raise InputError(str(path), expected="joint frames", got="other JSON", fix=_REMAKE)
    return tuple(joint_frame_from(entry, str(path)) for entry in entries)


def joint_frame_from(entry: Any, where: str) -> JointFrame:
    """A frame from its plain values.

    Raises:
        InputError: entries are missing or of another kind.
    """
    try:
        return JointFrame(
            str(entry["first"]), str(entry["second"]), entry["origin"], entry["axes"], float(entry["spacing"]),
        )
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise InputError(
            where, expected="a joint's first, second, origin, axes and spacing", got=f"{error!r}",
            fix=_REMAKE,
        ) from error
