"""POLYDATA: points, polygons and what is known at the points."""

import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from mixpinn.base.arrays import AnyArray
from mixpinn.server.igtl.damaged import DamagedMessage

_COUNTS = struct.Struct(">10I")
_ATTRIBUTE = struct.Struct(">BBI")
_SCALARS, _VECTORS, _NORMALS, _TENSORS, _RGBA = 0, 1, 2, 3, 4
_CELLS = 0x10


@dataclass(frozen=True, eq=False)
class PolyDataBody:
    """A surface of p points and polygons with c corners each.

    Attributes:
        points: shape (p, 3).
        polygons: ids of points, shape (f, c).
        attributes: values at the points by name: scalars, shape (p,), or vectors, shape (p, 3).
    """

    TYPE: ClassVar[str] = "POLYDATA"
    points: AnyArray
    polygons: AnyArray
    attributes: Mapping[str, AnyArray] = field(default_factory=dict)

    def pack(self) -> bytes:
        """Counts, points, polygons and attributes, all of them big-endian and in 32 bits."""
        return surface_content(self.points, polygon_bytes(self.polygons), len(self.polygons), self.attributes)

    @staticmethod
    def unpack(content: bytes) -> "PolyDataBody":
        """Read a surface whose polygons have equally many corners; vertices, lines, strips and values of cells are
        left out.

        Raises:
            DamagedMessage: sizes that do not fit each other, or polygons of different kinds.
        """
        if len(content) < _COUNTS.size:
            raise DamagedMessage(f"POLYDATA has {_COUNTS.size} bytes or more, not {len(content)}")
        n, _, vertices, _, lines, faces, size, _, strips, n_attributes = _COUNTS.unpack_from(content)
        start = _COUNTS.size
        stop = start + 12 * n
        first, last = stop + vertices + lines, stop + vertices + lines + size
        end = last + strips
        if end > len(content) or size % 4 or (faces and size % (4 * faces)) or bool(faces) != bool(size):
            raise DamagedMessage("POLYDATA: points and polygons do not fill what is announced for them")
        points = np.frombuffer(content[start:stop], dtype=">f4").reshape(n, 3).astype(np.float32)
        table = np.frombuffer(content[first:last], dtype=">u4").reshape(faces, size // (4 * max(faces, 1)))
        if faces and (table[:, 0] != table.shape[1] - 1).any():
            raise DamagedMessage("POLYDATA: polygons with different numbers of corners are not taken")
        polygons = table[:, 1:].astype(np.int64)
        if polygons.size and polygons.max() >= n:
            raise DamagedMessage(f"POLYDATA: a polygon names point {polygons.max()} of {n}")
        return PolyDataBody(points, polygons, _attributes(content[end:], n_attributes, n))


def polygon_bytes(polygons: AnyArray) -> bytes:
    """The part of a surface that says how its points are joined, for `surface_content`; ids of shape (f, c)."""
    polygons = np.asarray(polygons)
    corners = np.full((len(polygons), 1), polygons.shape[1])
    return np.hstack([corners, polygons]).astype(">u4").tobytes()


def surface_content(
    points: AnyArray, polygons: bytes, n_polygons: int, attributes: Mapping[str, AnyArray],
) -> bytes:
    """The content of a surface whose polygons were written before.

    Args:
        points: shape (p, 3).
        polygons: what `polygon_bytes` made.
        n_polygons: how many they are.
        attributes: values at the points by name, shape (p,) or (p, 3).
    """
    kinds, names, values = [], [], []
    for name, data in attributes.items():
        array = np.asarray(data)
        vectors = array.ndim == 2
        kinds.append(_ATTRIBUTE.pack(_VECTORS if vectors else _SCALARS, 3 if vectors else 1, len(array)))
        names.append(name.encode("ascii", "replace")[:255] + b"\0")
        values.append(array.astype(">f4").tobytes())
    named = b"".join(names)
    return b"".join([
        _COUNTS.pack(len(points), 0, 0, 0, 0, n_polygons, len(polygons), 0, 0, len(attributes)),
        np.asarray(points).astype(">f4").tobytes(), polygons, *kinds, named, b"\0" * (len(named) % 2), *values,
    ])


def _attributes(content: bytes, count: int, n_points: int) -> dict[str, AnyArray]:
    if count * _ATTRIBUTE.size > len(content):
        raise DamagedMessage("POLYDATA: the attributes are cut off")
    kinds = [_ATTRIBUTE.unpack_from(content, _ATTRIBUTE.size * i) for i in range(count)]
    at = begin = _ATTRIBUTE.size * count
    names = []
    for _ in range(count):
        end = content.find(b"\0", at)
        if end < 0:
            raise DamagedMessage("POLYDATA: an attribute's name has no end")
        names.append(content[at:end].decode("ascii", "replace"))
        at = end + 1
    at += (at - begin) % 2
    found: dict[str, AnyArray] = {}
    for name, (kind, components, length) in zip(names, kinds, strict=True):
        width = 1 if kind & 0x0F == _RGBA else 4
        stop = at + width * components * length
        if stop > len(content):
            raise DamagedMessage(f"POLYDATA: attribute {name!r} is cut off")
        if kind < _CELLS and width == 4 and length == n_points and components:
            values = np.frombuffer(content[at:stop], dtype=">f4").reshape(length, components).astype(np.float32)
            found[name] = values[:, 0] if components == 1 else values
        at = stop
    return found
