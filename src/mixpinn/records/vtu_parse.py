"""Reading VTK's ``.vtu`` without VTK: its XML and its arrays, of which nothing is believed before it is checked.

VTK's own reader trusts counts, offsets and sizes; a damaged file ends its process or takes all memory. Here a count is
compared with the arrays, every block is unpacked to at most the size that it must have, and whatever does not fit is a
`ValueError`. Encodings: text, base64 (inline and appended) and raw (appended), uncompressed, zlib or LZMA.
"""

import base64
import binascii
import math
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mixpinn.base.arrays import AnyArray
from mixpinn.base.bounded import Packing, memory_at_hand, plausible_count, unpack

_TYPES = {
    "Int8": "i1", "UInt8": "u1", "Int16": "i2", "UInt16": "u2", "Int32": "i4", "UInt32": "u4", "Int64": "i8",
    "UInt64": "u8", "Float32": "f4", "Float64": "f8", "String": "u1",
}
_COMPRESSORS: dict[str | None, Packing | None] = {
    None: None, "vtkZLibDataCompressor": "zlib", "vtkLZMADataCompressor": "lzma",
}
_APPENDED = re.compile(rb"<AppendedData\s+encoding\s*=\s*\"(raw|base64)\"\s*>\s*_")
Texts = list[str]


class UnknownEncodingError(ValueError):
    """A sound file, perhaps, in an encoding that is not known here."""


@dataclass(frozen=True, eq=False)
class ParsedGrid:
    """An unstructured grid; n points, m cells with c corners in all.

    Attributes:
        points: shape (n, 3).
        connectivity: corners of the cells one after another, each below n, shape (c,).
        offsets: where each cell ends in them, shape (m,).
        types: VTK's number of each cell's kind, shape (m,).
        point_data, cell_data: arrays by name, shapes (n, …) and (m, …).
        field_data: arrays or texts by name.
    """

    points: AnyArray
    connectivity: AnyArray
    offsets: AnyArray
    types: AnyArray
    point_data: Mapping[str, AnyArray]
    cell_data: Mapping[str, AnyArray]
    field_data: Mapping[str, AnyArray | Texts]


def parse_vtu(content: bytes) -> ParsedGrid:
    """The grid in a ``.vtu`` of one piece.

    Raises:
        UnknownEncodingError: several pieces, or compressed in a way that is not known here.
        ValueError: damaged, or no such file.
    """
    file = _File.of(content)
    pieces = file.root.findall("UnstructuredGrid/Piece")
    if len(pieces) != 1:
        raise (UnknownEncodingError if pieces else ValueError)(f"{len(pieces)} pieces")
    piece = pieces[0]
    n_points, n_cells = (plausible_count(piece.get(f"NumberOf{kind}")) for kind in ("Points", "Cells"))
    points = piece.find("Points/DataArray")
    if points is None:
        raise ValueError("no points")
    cells = {str(array.get("Name")): array for array in piece.findall("Cells/DataArray")}
    if not {"connectivity", "offsets", "types"} <= set(cells):
        raise ValueError("no cells")
    offsets = file.values(cells["offsets"], rows=n_cells)
    corners = int(offsets[-1]) if n_cells else 0
    connectivity = file.values(cells["connectivity"], rows=corners)
    if offsets.dtype.kind not in "iu" or connectivity.dtype.kind not in "iu":
        raise ValueError("corners of cells that are no whole numbers")
    if (np.diff(offsets.astype(np.int64), prepend=0) < 0).any():
        raise ValueError("cells that overlap")
    if corners and (connectivity.min() < 0 or connectivity.max() >= n_points):
        raise ValueError(f"cells with points that are not among the {n_points}")
    return ParsedGrid(
        file.values(points, rows=n_points, width=3), connectivity, offsets, file.values(cells["types"], rows=n_cells),
        file.group(piece, "PointData", n_points), file.group(piece, "CellData", n_cells), file.field_data(),
    )


@dataclass(frozen=True, eq=False)
class _File:
    """The parsed XML, and how arrays are encoded in it."""

    root: ElementTree.Element
    appended: bytes
    raw: bool
    order: Literal["<", ">"]
    header: str
    packing: Packing | None

    @staticmethod
    def of(content: bytes) -> "_File":
        found, appended, raw = _APPENDED.search(content), b"", False
        if found:
            end = content.rfind(b"</AppendedData>")
            raw = found[1] == b"raw"
            appended = content[found.end():end if end >= 0 else len(content)]
            content = content[:found.start()] + b"</VTKFile>"
        if b"<!DOCTYPE" in content[:4096] or b"<!ENTITY" in content:
            raise ValueError("a document type of its own")
        try:
            root = ElementTree.fromstring(content)
        except (ElementTree.ParseError, ValueError, LookupError) as error:
            raise ValueError(f"no XML that can be read ({error})") from error
        if root.tag != "VTKFile" or root.get("type") != "UnstructuredGrid":
            raise ValueError("not a VTK file of an unstructured grid")
        compressor = root.get("compressor")
        if compressor not in _COMPRESSORS:
            raise UnknownEncodingError(f"compressed by {compressor}")
        header = {"UInt32": "u4", "UInt64": "u8"}.get(root.get("header_type", "UInt32"))
        order = {"LittleEndian": "<", "BigEndian": ">"}.get(root.get("byte_order", "LittleEndian"))
        if header is None or order is None:
            raise ValueError("an unknown order of bytes or type of header")
        return _File(root, appended, raw, "<" if order == "<" else ">", header, _COMPRESSORS[compressor])

    def group(self, piece: ElementTree.Element, name: str, rows: int) -> dict[str, AnyArray]:
        """The arrays of numbers on points or cells by name."""
        arrays = {}
        for element in piece.findall(f"{name}/DataArray"):
            width = plausible_count(element.get("NumberOfComponents", "1"), most=1 << 20)
            arrays[str(element.get("Name"))] = self.values(element, rows=rows, width=width)
        return arrays

    def field_data(self) -> dict[str, AnyArray | Texts]:
        """Arrays and texts of the whole by name."""
        found: dict[str, AnyArray | Texts] = {}
        for element in self.root.findall("UnstructuredGrid/FieldData/*"):
            rows = plausible_count(element.get("NumberOfTuples"))
            width = plausible_count(element.get("NumberOfComponents", "1"), most=1 << 20)
            name = str(element.get("Name"))
            if element.get("type") == "String":
                found[name] = self._texts(element, rows * width)
            else:
                found[name] = self.values(element, rows=rows, width=width)
        return found

    def values(self, element: ElementTree.Element, *, rows: int, width: int = 1) -> AnyArray:
        """The numbers of an array, shape (rows,) or (rows, width)."""
        kind = _TYPES.get(element.get("type", ""))
        if kind is None:
            raise ValueError(f"an array of type {element.get('type')}")
        dtype = np.dtype(self.order + kind)
        if rows * width * dtype.itemsize > memory_at_hand():
            raise ValueError(f"an array of {rows} rows, which does not fit into memory")
        flat = self._numbers(element, dtype, rows * width)
        if len(flat) != rows * width:
            raise ValueError(f"{len(flat)} numbers in {element.get('Name')} instead of {rows * width}")
        flat = flat.astype(dtype.newbyteorder("="), copy=False)
        return flat if width == 1 else flat.reshape(rows, width)

    def _texts(self, element: ElementTree.Element, count: int) -> Texts:
        encoded = self._numbers(element, np.dtype("u1"), None).astype(np.uint8).tobytes()
        texts = encoded.split(b"\x00")[:-1]
        if len(texts) != count:
            raise ValueError(f"{len(texts)} texts in {element.get('Name')} instead of {count}")
        return [text.decode("utf-8", "backslashreplace") for text in texts]

    def _numbers(self, element: ElementTree.Element, dtype: "np.dtype[np.generic]", count: int | None) -> AnyArray:
        """All numbers of an array; of `count` numbers, where that is known."""
        most = None if count is None else count * dtype.itemsize
        form = element.get("format", "ascii")
        if form == "appended":
            at = plausible_count(element.get("offset"), most=len(self.appended))
            return np.frombuffer(self._bytes(self.appended[at:], raw=self.raw, most=most), dtype)
        text = "".join([element.text or "", *(child.tail or "" for child in element)])
        if form == "binary":
            return np.frombuffer(self._bytes("".join(text.split()).encode("ascii"), raw=False, most=most), dtype)
        if form != "ascii":
            raise ValueError(f"numbers in the format {form}")
        words = text.split()
        if count is not None and len(words) != count:
            raise ValueError(f"{len(words)} numbers in {element.get('Name')} instead of {count}")
        if dtype.kind == "f":
            return np.array(words, dtype=np.float64).astype(dtype)
        try:
            numbers = np.array(words, dtype=np.int64)
        except OverflowError as error:
            raise ValueError(f"numbers in {element.get('Name')} that are too large") from error
        held = numbers.astype(dtype)
        if count is not None and (held != numbers).any():  # characters of texts may be written as signed ones
            raise ValueError(f"numbers in {element.get('Name')} that {element.get('type')} cannot hold")
        return held

    def _bytes(self, encoded: bytes, *, raw: bool, most: int | None) -> bytes | bytearray:
        """What one array holds; `encoded` may go on behind it."""
        word = np.dtype(self.order + self.header)
        limit = len(encoded) * 1100 if most is None else most
        if self.packing is None:
            head = _decoded(encoded, 0, word.itemsize, raw=raw)
            size = int(np.frombuffer(head, word)[0])
            if size > limit:
                raise ValueError(f"an array of {size} bytes")
            return _decoded(encoded, 0, word.itemsize + size, raw=raw)[word.itemsize:]
        blocks, size, last = (int(n) for n in np.frombuffer(_decoded(encoded, 0, 3 * word.itemsize, raw=raw), word))
        if not blocks:
            return b""
        total = size * blocks if not last else size * (blocks - 1) + last
        if total > limit or blocks > len(encoded):
            raise ValueError(f"an array of {total} bytes")
        length = (3 + blocks) * word.itemsize
        packed = np.frombuffer(_decoded(encoded, 0, length, raw=raw), word)[3:].astype(np.int64)
        if (packed < 0).any() or (packed > len(encoded)).any() or int(packed.sum()) > len(encoded):
            raise ValueError("an array that is longer than the file")
        body = _decoded(encoded, length if raw else 4 * math.ceil(length / 3), int(packed.sum()), raw=raw)
        whole = bytearray()
        for index, (end, part) in enumerate(zip(np.cumsum(packed), packed, strict=True)):
            wanted = last if last and index == blocks - 1 else size
            piece = unpack(body[end - part:end], self.packing, most=wanted)
            if len(piece) != wanted:
                raise ValueError(f"a block of {len(piece)} bytes instead of {wanted}")
            whole += piece
        return whole


def _decoded(encoded: bytes, start: int, count: int, *, raw: bool) -> bytes:
    """`count` bytes of what is encoded from place `start` on."""
    if raw:
        found = encoded[start:start + count]
    else:
        try:
            found = base64.b64decode(encoded[start:start + 4 * math.ceil(count / 3)], validate=True)[:count]
        except (binascii.Error, ValueError) as error:
            raise ValueError(f"no base64 ({error})") from error
    if len(found) != count:
        raise ValueError("an array that ends too early")
    return found
