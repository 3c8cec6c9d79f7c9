"""Reading NRRD, and Slicer's segmentations in it, as a label image."""

import re
from pathlib import Path

import numpy as np

from mixpinn.anatomy.images.label_image import LPS_TO_RAS, LabelImage, file_beside, flattened, make_label_image
from mixpinn.base.arrays import AnyArray, FloatArray
from mixpinn.base.bounded import Packing, unpack
from mixpinn.base.errors import InputError
from mixpinn.records.voxels import check_extents

_TYPES = {
    **dict.fromkeys(("signed char", "int8", "int8_t"), "i1"),
    **dict.fromkeys(("uchar", "unsigned char", "uint8", "uint8_t"), "u1"),
    **dict.fromkeys(("short", "short int", "signed short", "signed short int", "int16", "int16_t"), "i2"),
    **dict.fromkeys(("ushort", "unsigned short", "unsigned short int", "uint16", "uint16_t"), "u2"),
    **dict.fromkeys(("int", "signed int", "int32", "int32_t"), "i4"),
    **dict.fromkeys(("uint", "unsigned int", "uint32", "uint32_t"), "u4"),
    **dict.fromkeys(("longlong", "long long", "long long int", "signed long long", "int64", "int64_t"), "i8"),
    **dict.fromkeys(("ulonglong", "unsigned long long", "unsigned long long int", "uint64", "uint64_t"), "u8"),
    "float": "f4", "double": "f8",
}
_FRAMES = {
    "left-posterior-superior": LPS_TO_RAS, "lps": LPS_TO_RAS, "right-anterior-superior": np.eye(4), "ras": np.eye(4),
    "left-anterior-superior": np.diag([-1.0, 1.0, 1.0, 1.0]), "las": np.diag([-1.0, 1.0, 1.0, 1.0]),
}
_PACKINGS: dict[str, Packing | None] = {"raw": None, "gzip": "gzip", "gz": "gzip", "bzip2": "bzip2", "bz2": "bzip2"}
_UNITS = {"mm": 1.0, "": 1.0, "cm": 10.0, "m": 1000.0, "um": 0.001, "µm": 0.001}
_SEGMENT = re.compile(r"Segment(\d+)_(Name|LabelValue|Layer)$")


def read_nrrd(path: Path) -> LabelImage:
    """Read a ``.nrrd`` or ``.nhdr`` (raw, gzip or bzip2) as a label image; names and layers as Slicer writes them.

    Where Slicer keeps overlapping segments in layers, the larger are painted first and smaller ones over them.

    Raises:
        InputError: absent, damaged, of another kind, without an orientation, or not a label map.
    """
    content = path.read_bytes()
    fields, pairs, body = _header(path, content)
    dimension = _number(path, fields, "dimension")
    try:
        sizes = [int(word) for word in _field(path, fields, "sizes").split()]
    except ValueError as error:
        raise _bad(path, "numbers as 'sizes'", fields["sizes"][:60]) from error
    if dimension not in (3, 4) or len(sizes) != dimension or min(sizes) < 1:
        raise _bad(path, "three dimensions (and one of layers)", f"sizes {sizes}")
    vectors = _vectors(path, fields)
    layered = dimension == 4
    if len(vectors) != dimension:
        raise _bad(path, f"a direction for each of {dimension} axes", fields["space directions"][:60])
    if layered and (vectors[0] is not None or None in vectors[1:]):
        raise _bad(path, "layers along the first axis", fields.get("space directions", "nothing"))
    affine = _affine(path, fields, [vector for vector in vectors if vector is not None])
    data = _data(path, fields, body, sizes)
    segments = _segments(path, pairs)
    if not layered:
        names = {value: name for name, value, _ in segments}
        return make_label_image(path, data, affine, names=names)
    labels, names, notes = flattened(path, _masks(path, data, segments))
    return make_label_image(path, labels, affine, names=names, notes=notes)


def _bad(path: Path, expected: str, got: str) -> InputError:
    return InputError(str(path), expected=expected, got=got, fix="export it as .nii.gz")


def _header(path: Path, content: bytes) -> tuple[dict[str, str], dict[str, str], bytes]:
    end = re.search(rb"\r?\n\r?\n", content)
    text = content[: end.start() if end else len(content)].decode("utf-8", errors="replace")
    fields: dict[str, str] = {}
    pairs: dict[str, str] = {}
    for line in text.splitlines()[1:]:
        if line.startswith("#"):
            continue
        key, sign, value = line.partition(":=")
        if sign:
            pairs[key.strip()] = value.strip()
            continue
        key, sign, value = line.partition(":")
        if sign:
            fields[key.strip().lower()] = value.strip()
    return fields, pairs, content[end.end():] if end else b""


def _field(path: Path, fields: dict[str, str], name: str) -> str:
    if name not in fields:
        raise _bad(path, f"a NRRD header with {name!r}", "none")
    return fields[name]


def _number(path: Path, fields: dict[str, str], name: str) -> int:
    try:
        return int(_field(path, fields, name))
    except ValueError as error:
        raise _bad(path, f"a number as {name!r}", fields[name]) from error


def _vectors(path: Path, fields: dict[str, str]) -> list[list[float] | None]:
    if "space" not in fields or "space directions" not in fields or "space origin" not in fields:
        raise InputError(
            str(path), expected="an orientation (space, space directions, space origin)",
            got="a header without, so left and right are unknown", fix="write the image with its orientation",
        )
    return [_vector(path, word) for word in re.findall(r"none|\([^)]*\)", fields["space directions"])]


def _vector(path: Path, word: str) -> list[float] | None:
    if word == "none":
        return None
    try:
        x, y, z = (float(part) for part in word.strip("()").split(","))
    except ValueError as error:
        raise _bad(path, "vectors (x,y,z)", word) from error
    return [x, y, z]


def _affine(path: Path, fields: dict[str, str], vectors: list[list[float]]) -> FloatArray:
    frame = _FRAMES.get(fields["space"].lower())
    unit = {word.strip('" ').lower() for word in re.findall(r'"[^"]*"', fields.get("space units", ""))}
    origin = _vector(path, fields["space origin"])
    if frame is None or len(vectors) != 3 or origin is None or len(unit) > 1 or not unit <= set(_UNITS):
        raise _bad(
            path, f"three directions in one of {', '.join(sorted(_FRAMES))}, in mm",
            f"{len(vectors)} directions in {fields['space']!r}, {', '.join(unit) or 'mm'}",
        )
    affine = np.eye(4)
    affine[:3, :3] = np.array(vectors).T
    affine[:3, 3] = origin
    affine[:3] *= _UNITS[next(iter(unit), "mm")]
    turned: FloatArray = frame @ affine
    return turned


def _data(path: Path, fields: dict[str, str], body: bytes | bytearray, sizes: list[int]) -> AnyArray:
    kind = _TYPES.get(_field(path, fields, "type").lower())
    encoding = _field(path, fields, "encoding").lower()
    file = fields.get("data file", fields.get("datafile"))
    if file is not None:
        body = file_beside(path, file).read_bytes()
    skipped = next((name for name in ("line skip", "lineskip", "byte skip", "byteskip") if name in fields), None)
    if skipped is not None:
        raise _bad(path, "voxels right behind the header", f"{skipped}: {fields[skipped]}")
    if kind is None:
        raise _bad(path, "whole or floating-point numbers", fields["type"])
    dtype = np.dtype(kind).newbyteorder(">" if fields.get("endian", "little").lower() == "big" else "<")
    expected = check_extents(sizes, dtype.itemsize, str(path))
    if encoding not in _PACKINGS:
        raise _bad(path, "raw, gzip or bzip2 encoding", encoding)
    packing = _PACKINGS[encoding]
    try:
        body = body if packing is None else unpack(body, packing, most=expected)
    except ValueError as error:
        raise InputError(
            str(path), expected="a complete NRRD file", got=f"a damaged one ({error})", fix="copy or write it again",
        ) from error
    if len(body) != expected:
        raise InputError(
            str(path), expected=f"{expected} bytes of voxels", got=f"{len(body)}", fix="copy or write it again",
        )
    data: AnyArray = np.frombuffer(body, dtype=dtype).reshape(sizes, order="F")
    return data


def _segments(path: Path, pairs: dict[str, str]) -> list[tuple[str, int, int]]:
    """Name, value and layer of each segment."""
    found: dict[str, dict[str, str]] = {}
    for key, value in pairs.items():
        if match := _SEGMENT.match(key):
            found.setdefault(match[1], {})[match[2]] = value
    try:
        return [
            (entry["Name"], int(entry["LabelValue"]), int(entry.get("Layer", 0))) for entry in found.values()
            if "Name" in entry and "LabelValue" in entry
        ]
    except ValueError as error:
        raise _bad(path, "a number for each segment", str(error)) from error


def _masks(path: Path, data: AnyArray, segments: list[tuple[str, int, int]]) -> list[tuple[str, AnyArray]]:
    if not segments:
        raise _bad(path, "names and numbers of the segments of each layer", "none")
    return [(name, data[layer] == value) for name, value, layer in segments if 0 <= layer < len(data)]
