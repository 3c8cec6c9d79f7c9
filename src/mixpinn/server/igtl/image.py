"""IMAGE: a grid of voxels with its place; the matrix's last column is the image's centre."""

import math
import struct
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from mixpinn.base.arrays import AnyArray, FloatArray
from mixpinn.server.igtl.damaged import DamagedMessage
from mixpinn.server.igtl.scalars import SCALARS, scalar_code

_LAYOUT = struct.Struct(">HBBBB3H12f3H3H")
_BIG, _LITTLE = 1, 2
_RAS, _LPS = 1, 2
_LPS_TO_RAS = np.diag([-1.0, -1.0, 1.0, 1.0])


@dataclass(frozen=True, eq=False)
class ImageBody:
    """A volume in RAS.

    Attributes:
        voxels: index i runs fastest, shape (nk, nj, ni), or (nk, nj, ni, c) with c components a voxel.
        matrix: voxel index (i, j, k, 1) to RAS [mm], shape (4, 4).
    """

    TYPE: ClassVar[str] = "IMAGE"
    voxels: AnyArray
    matrix: FloatArray

    def pack(self) -> bytes:
        """72 bytes about the voxels, then these, interleaved, little-endian.

        Raises:
            ValueError: an element type, a shape or a number of components that the protocol lacks.
        """
        voxels = np.asarray(self.voxels)
        components = voxels.shape[3] if voxels.ndim == 4 else 1
        if voxels.ndim not in (3, 4) or max(voxels.shape[:3]) > 65535 or not 1 <= components <= 255:
            raise ValueError(f"IMAGE's voxels have shape (nk, nj, ni) or (nk, nj, ni, c), not {voxels.shape}")
        size = voxels.shape[2::-1]
        centre = self.matrix @ np.array([*(0.5 * (n - 1) for n in size), 1.0])
        return _LAYOUT.pack(
            1, components, scalar_code(voxels.dtype), _LITTLE, _RAS, *size, *self.matrix[:3, :3].T.ravel(),
            *centre[:3], 0, 0, 0, *size,
        ) + voxels.astype(voxels.dtype.newbyteorder("<")).tobytes()

    @staticmethod
    def unpack(content: bytes) -> "ImageBody":
        """Read an image that comes as a whole, in RAS or LPS and in either byte order.

        Raises:
            DamagedMessage: an unknown element type, a part of an image, another number of bytes than the shape asks
                for, or a place that is not finite.
        """
        if len(content) < _LAYOUT.size:
            raise DamagedMessage(f"IMAGE has {_LAYOUT.size} bytes or more, not {len(content)}")
        _, components, code, endian, coordinates, *rest = _LAYOUT.unpack_from(content)
        size, numbers, part = tuple(rest[:3]), rest[3:15], tuple(rest[15:])
        if code not in SCALARS or endian not in (_BIG, _LITTLE) or coordinates not in (_RAS, _LPS) or not components:
            raise DamagedMessage("IMAGE: element type, byte order or frame is not known here")
        if part != (0, 0, 0, *size):
            raise DamagedMessage("IMAGE: parts of images are not taken")
        shape = (*size[::-1], components) if components > 1 else size[::-1]
        data, dtype = content[_LAYOUT.size:], SCALARS[code]
        if len(data) != math.prod(shape) * dtype.itemsize:
            raise DamagedMessage(f"IMAGE: {len(data)} bytes do not make voxels {shape} of {dtype}")
        matrix = np.eye(4)
        matrix[:3] = np.array(numbers).reshape(4, 3).T
        matrix[:3, 3] -= matrix[:3, :3] @ (0.5 * (np.array(size) - 1.0))
        if not np.isfinite(matrix).all():
            raise DamagedMessage("IMAGE: the matrix holds nan or inf")
        ordered = np.frombuffer(data, dtype=dtype.newbyteorder(">" if endian == _BIG else "<")).reshape(shape)
        return ImageBody(ordered.astype(dtype), matrix if coordinates == _RAS else _LPS_TO_RAS @ matrix)
