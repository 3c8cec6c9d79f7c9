"""NDARRAY: an array of numbers, row by row, big-endian."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from mixpinn.base.arrays import AnyArray
from mixpinn.server.igtl.damaged import DamagedMessage
from mixpinn.server.igtl.scalars import SCALARS, scalar_code


@dataclass(frozen=True, eq=False)
class NdarrayBody:
    """An array.

    Attributes:
        array: of one of the types in `SCALARS`, at most 255 axes of at most 65,535 elements.
    """

    TYPE: ClassVar[str] = "NDARRAY"
    array: AnyArray

    def pack(self) -> bytes:
        """Element type, number of axes, their lengths, elements.

        Raises:
            ValueError: an element type or a length that the protocol lacks.
        """
        array = np.asarray(self.array)
        if max(array.shape, default=0) > 65535:
            raise ValueError(f"NDARRAY's axes have 65535 elements at most, not {array.shape}")
        return (
            bytes([scalar_code(array.dtype), array.ndim]) + np.array(array.shape, dtype=">u2").tobytes()
            + array.astype(array.dtype.newbyteorder(">")).tobytes()
        )

    @staticmethod
    def unpack(content: bytes) -> "NdarrayBody":
        """Read what `pack` wrote.

        Raises:
            DamagedMessage: an unknown element type, or another number of bytes than the shape asks for.
        """
        if len(content) < 2 or content[0] not in SCALARS:
            raise DamagedMessage("NDARRAY: the element type is not known here")
        dtype, axes = SCALARS[content[0]], content[1]
        start = 2 + 2 * axes
        if len(content) < start:
            raise DamagedMessage("NDARRAY: the shape is cut off")
        shape = tuple(int(length) for length in np.frombuffer(content, dtype=">u2", count=axes, offset=2))
        if len(content) - start != math.prod(shape) * dtype.itemsize:
            raise DamagedMessage(f"NDARRAY: {len(content) - start} bytes do not make an array {shape} of {dtype}")
        return NdarrayBody(np.frombuffer(content[start:], dtype=dtype.newbyteorder(">")).reshape(shape).astype(dtype))
