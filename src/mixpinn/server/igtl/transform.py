"""TRANSFORM: a 4 × 4 matrix, its upper three rows column by column as 32-bit numbers."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from mixpinn.base.arrays import AnyArray, FloatArray
from mixpinn.server.igtl.damaged import DamagedMessage


@dataclass(frozen=True, eq=False)
class TransformBody:
    """A linear transform.

    Attributes:
        matrix: in mm, shape (4, 4); the last row is (0, 0, 0, 1).
    """

    TYPE: ClassVar[str] = "TRANSFORM"
    matrix: FloatArray

    def pack(self) -> bytes:
        """48 bytes."""
        return np.asarray(self.matrix)[:3].T.astype(">f4").tobytes()

    @staticmethod
    def unpack(content: bytes) -> "TransformBody":
        """Read what `pack` wrote.

        Raises:
            DamagedMessage: another number of bytes, or numbers that are not finite.
        """
        if len(content) != 48:
            raise DamagedMessage(f"TRANSFORM has 48 bytes, not {len(content)}")
        matrix = np.eye(4)
        matrix[:3] = np.frombuffer(content, dtype=">f4").reshape(4, 3).T
        if not np.isfinite(matrix).all():
            raise DamagedMessage("TRANSFORM: the matrix holds nan or inf")
        return TransformBody(matrix)


def rigid_matrix(rotation: AnyArray, translation: AnyArray) -> FloatArray:
    """x ↦ R x + t as a matrix, shape (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, translation
    return matrix
