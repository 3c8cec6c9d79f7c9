"""The wire protocol, version 1: binary frames that carry answers and surfaces (docs/reference/live-protocol.md).

Everything is little-endian. An answer's frame is, one part after another:

====================  =======================================================================================
part                  content
====================  =======================================================================================
head                  `HEAD`, 96 bytes
probes                p records of `PROBE`, 112 bytes each
rigid parts           K records of `PART`, 72 bytes each
notes                 JSON list of texts in UTF-8, filled up with blanks to a multiple of four bytes
displacement          v vertices, x y z each, int16 or float32; int16 is filled up to a multiple of four bytes
errors                only with the flag ``ERRORS``: expected error of each vertex, v uint16, filled up likewise
====================  =======================================================================================
"""

import json
import struct
from dataclasses import dataclass
from enum import IntEnum, IntFlag, StrEnum
from typing import Any

import numpy as np

from mixpinn.base.arrays import AnyArray, Float32Array, IntArray
from mixpinn.base.errors import InputError
from mixpinn.records.answer import Answer, Trust
from mixpinn.serving.live.records import LiveAnswer

VERSION = 1
SUBPROTOCOL = "mixpinn.live.1"
MAGIC, SURFACE_MAGIC, TISSUE_MAGIC = b"MXLV", b"MXSF", b"MXTS"


class Kind(IntEnum):
    """What a frame of an answer is."""

    LIVE = 1
    REPLAY = 2
    FULL_SOLUTION = 3


class Encoding(IntEnum):
    """How displacements travel."""

    NONE = 0
    INT16 = 1
    FLOAT32 = 2


class Vertices(IntEnum):
    """Of which vertices."""

    SKIN = 0
    NODES = 1


class Flag(IntFlag):
    """What an answer is."""

    CONVERGED = 1
    OUTSIDE = 2
    TOUCHES = 4
    REMEMBERED = 8
    ERRORS = 16


class ErrorCode(StrEnum):
    """Kinds of errors that a client is told of."""

    BAD_MESSAGE = "bad-message"
    BAD_POSE = "bad-pose"
    REFUSED = "refused"
    BUSY = "busy"
    TOO_FAST = "too-fast"


HEAD = np.dtype([
    ("magic", "S4"), ("version", "u1"), ("kind", "u1"), ("encoding", "u1"), ("vertices", "u1"),
    ("pose_id", "<u4"), ("sequence", "<u4"), ("flags", "<u4"), ("n_probes", "<u4"), ("n_parts", "<u4"),
    ("n_vertices", "<u4"), ("notes_bytes", "<u4"), ("scale", "<f4"), ("time", "<f8"), ("solve_ms", "<f4"),
    ("age_ms", "<f4"), ("expected", "<f4"), ("bound", "<f4"), ("level", "<f4"), ("force_expected", "<f4"),
    ("force_bound", "<f4"), ("motion_expected", "<f4"), ("motion_bound", "<f4"), ("largest", "<f4"),
    ("error_scale", "<f4"), ("reserved", "<f4"),
])
"""Head of a frame. `scale`, `error_scale`: mm of one unit of int16 (or 1) and of the errors' uint16. `largest`: largest
displacement of any node [mm]. Trust that is not known is nan."""
PROBE = np.dtype([
    ("index", "<u4"), ("pose_id", "<u4"), ("depth", "<f4"), ("touches", "<u4"), ("matrix", "<f4", (4, 4)),
    ("force", "<f4", 3), ("moment", "<f4", 3), ("reserved", "<f4", 2),
])
"""One probe: pose as a row-major matrix from the probe's frame to the world, force of the tissue on it [N], moment
about its tip [N mm], depth beyond first touch [mm] (−inf: no skin in its way)."""
PART = np.dtype([("matrix", "<f4", (4, 4)), ("distance", "<f4"), ("angle_deg", "<f4")])
"""One rigid part: row-major matrix from its place at rest to where it is, world [mm]; way of its centroid, angle."""
_FINEST = 1e-3
"""Finest unit of int16 [mm]; larger displacements get a coarser one."""

assert HEAD.itemsize == 96
assert PROBE.itemsize == 112
assert PART.itemsize == 72


@dataclass(frozen=True, eq=False)
class Frame:
    """What `decode_answer` reads; p probes, K parts, v vertices.

    Attributes:
        kind: what the answer is.
        vertices: of which vertices.
        pose_id, sequence, flags, time, solve_ms, age_ms: as in `HEAD`.
        trust: expected errors and bounds.
        probes: records of `PROBE`, shape (p,).
        parts: records of `PART`, shape (K,).
        displacement: [mm], float32, shape (v, 3); (0, 3) where none was asked for.
        errors: expected error of each vertex [mm], float32, shape (v,); None where they were not asked for.
    """

    kind: Kind
    vertices: Vertices
    pose_id: int
    sequence: int
    flags: Flag
    time: float
    solve_ms: float
    age_ms: float
    trust: Trust
    probes: AnyArray
    parts: AnyArray
    displacement: Float32Array
    errors: Float32Array | None = None


def encode_answer(
    found: LiveAnswer, *, encoding: Encoding, vertices: IntArray | None = None, kind: Kind = Kind.LIVE,
    now: float | None = None, errors: AnyArray | None = None,
) -> bytes:
    """The frame of an answer.

    Args:
        found: the answer.
        encoding: of the displacement; `Encoding.NONE` leaves it out.
        vertices: nodes whose displacement is sent; None for all.
        kind: what it is.
        now: by `time.perf_counter`, to say how old the newest pose is.
        errors: expected error of every node [mm], shape (n,), if they are to be sent.
    """
    answer, newest = found.answer, found.newest
    trust = answer.trust or Trust()
    notes = _padded(json.dumps(answer.warnings(), ensure_ascii=False).encode(), b" ")
    probes = np.zeros(len(found.probes), PROBE)
    touches = False
    for row, probe, force, moment in zip(probes, found.probes, *_forces(answer, len(probes)), strict=True):
        row["index"], row["pose_id"], row["depth"] = probe.index, probe.pose_id, probe.depth
        row["touches"] = bool(np.any(force))
        row["matrix"] = np.eye(4)
        row["matrix"][:3, :3], row["matrix"][:3, 3] = probe.pose.rotation, probe.pose.translation
        row["force"], row["moment"] = force, moment
        touches = touches or bool(row["touches"])
    parts = np.zeros(len(found.matrices), PART)
    parts["matrix"] = found.matrices
    motions = [answer.motions[name] for name in answer.mesh.rigid_names if name in answer.motions]
    if len(motions) == len(parts):
        parts["distance"] = [motion.distance for motion in motions]
        parts["angle_deg"] = [motion.angle_deg for motion in motions]
    field = np.asarray(answer.displacement, dtype=np.float32)
    largest = float(np.sqrt((field**2).sum(axis=1).max(initial=0.0)))
    field = field[vertices] if vertices is not None else field
    if encoding is Encoding.NONE:
        field = field[:0]
    values, scale = _packed(field, encoding)
    flags = Flag.REMEMBERED if found.remembered else Flag(0)
    flags |= Flag.CONVERGED if trust.converged else Flag(0)
    flags |= Flag.OUTSIDE if trust.outside else Flag(0)
    flags |= Flag.TOUCHES if touches else Flag(0)
    head = np.zeros(1, HEAD)
    head["magic"], head["version"], head["kind"], head["encoding"] = MAGIC, VERSION, kind, encoding
    head["vertices"] = Vertices.NODES if vertices is None else Vertices.SKIN
    head["pose_id"], head["sequence"], head["flags"] = found.pose_id, found.sequence, flags
    head["n_probes"], head["n_parts"], head["n_vertices"] = len(probes), len(parts), len(field)
    head["notes_bytes"], head["scale"], head["time"] = len(notes), scale, found.time
    head["solve_ms"] = 1e3 * found.seconds
    head["age_ms"] = 1e3 * (now - newest.asked) if now is not None and newest is not None else 0.0
    for name in _TRUST:
        value = getattr(trust, name)
        head[name] = np.nan if value is None else value
    head["largest"] = largest
    shown = b""
    if errors is not None and encoding is not Encoding.NONE:
        chosen = np.asarray(errors if vertices is None else errors[vertices], dtype=np.float32)
        unit = max(1e-4, float(chosen.max(initial=0.0)) / 65535.0)
        head["flags"], head["error_scale"] = flags | Flag.ERRORS, unit
        shown = _padded(np.rint(chosen / np.float32(unit)).astype("<u2").tobytes(), b"\0")
    return b"".join((head.tobytes(), probes.tobytes(), parts.tobytes(), notes, values, shown))


_TRUST = ("expected", "bound", "level", "force_expected", "force_bound", "motion_expected", "motion_bound")


def decode_answer(data: bytes) -> Frame:
    """Read what `encode_answer` wrote.

    Raises:
        InputError: another kind of message, another version, or a frame that was cut.
    """
    if len(data) < HEAD.itemsize or data[:4] != MAGIC:
        raise _damaged("no head of an answer")
    head = np.frombuffer(data, HEAD, 1)[0]
    if head["version"] != VERSION:
        raise _damaged(f"version {head['version']}")
    encoding, n, flags = Encoding(head["encoding"]), int(head["n_vertices"]), Flag(int(head["flags"]))
    sizes = (
        HEAD.itemsize, PROBE.itemsize * int(head["n_probes"]), PART.itemsize * int(head["n_parts"]),
        int(head["notes_bytes"]), {Encoding.NONE: 0, Encoding.INT16: (6 * n + 3) // 4 * 4, Encoding.FLOAT32: 12 * n}[
            encoding],
        (2 * n + 3) // 4 * 4 if Flag.ERRORS in flags else 0,
    )
    if len(data) != sum(sizes):
        raise _damaged(f"{len(data)} bytes instead of {sum(sizes)}")
    starts = np.cumsum((0, *sizes))
    probes = np.frombuffer(data, PROBE, int(head["n_probes"]), starts[1])
    parts = np.frombuffer(data, PART, int(head["n_parts"]), starts[2])
    notes = json.loads(data[starts[3] : starts[4]])
    field = np.zeros((0, 3), np.float32)
    if encoding is Encoding.INT16:
        field = np.frombuffer(data, "<i2", 3 * n, starts[4]).reshape(-1, 3) * head["scale"]
    elif encoding is Encoding.FLOAT32:
        field = np.frombuffer(data, "<f4", 3 * n, starts[4]).reshape(-1, 3)
    errors = None
    if Flag.ERRORS in flags:
        errors = (np.frombuffer(data, "<u2", n, starts[5]) * head["error_scale"]).astype(np.float32)
    known = {name: None if np.isnan(head[name]) else float(head[name]) for name in _TRUST}
    trust = Trust(**known, outside=Flag.OUTSIDE in flags, converged=Flag.CONVERGED in flags, reasons=tuple(notes))
    return Frame(
        Kind(head["kind"]), Vertices(head["vertices"]), int(head["pose_id"]), int(head["sequence"]), flags,
        float(head["time"]), float(head["solve_ms"]), float(head["age_ms"]), trust, probes, parts,
        field.astype(np.float32), errors,
    )


def encode_surface(points: AnyArray, triangles: AnyArray, ids: AnyArray | None = None) -> bytes:
    """A surface: magic, number of vertices v and of triangles t, then v × 3 float32, t × 3 uint32, v × uint32 ids.

    Args:
        points: of the vertices [mm], shape (v, 3).
        triangles: outward, shape (t, 3).
        ids: a number of each vertex, by default 0, 1, …; of the skin: the node of the mesh, shape (v,).
    """
    numbers = np.arange(len(points)) if ids is None else ids
    head = struct.pack("<4sII", SURFACE_MAGIC, len(points), len(triangles))
    return b"".join((
        head, np.asarray(points, "<f4").tobytes(), np.asarray(triangles, "<u4").tobytes(),
        np.asarray(numbers, "<u4").tobytes(),
    ))


def encode_tissue(points: AnyArray, cells: AnyArray, kinds: AnyArray) -> bytes:
    """What the skin holds: magic, number of points n and of cells t, n × 3 float32, t × 4 uint32, then t uint8.

    Args:
        points: vertices of the mesh at rest [mm], shape (n, 3).
        cells: tetrahedra that deform, shape (t, 4).
        kinds: of each its tissue, shape (t,).
    """
    return b"".join((
        struct.pack("<4sII", TISSUE_MAGIC, len(points), len(cells)), np.asarray(points, "<f4").tobytes(),
        np.asarray(cells, "<u4").tobytes(), np.asarray(kinds, "u1").tobytes(),
    ))


def decode_surface(data: bytes) -> tuple[Float32Array, AnyArray, AnyArray]:
    """Points (v, 3) [mm], triangles (t, 3) and ids (v,) of what `encode_surface` wrote.

    Raises:
        InputError: something else, or cut.
    """
    if len(data) < 12 or data[:4] != SURFACE_MAGIC:
        raise _damaged("no surface")
    n, t = struct.unpack("<II", data[4:12])
    if len(data) != 12 + 16 * n + 12 * t:
        raise _damaged(f"{len(data)} bytes instead of {12 + 16 * n + 12 * t}")
    points = np.frombuffer(data, "<f4", 3 * n, 12).reshape(-1, 3)
    triangles = np.frombuffer(data, "<u4", 3 * t, 12 + 12 * n).reshape(-1, 3)
    return points, triangles, np.frombuffer(data, "<u4", n, 12 + 12 * n + 12 * t)


def error_message(error: InputError, code: ErrorCode, number: int | None = None) -> dict[str, Any]:
    """What a client is told of an error."""
    return {
        "type": "error", "code": code.value, "id": number, "what": error.what, "expected": error.expected,
        "got": error.got, "fix": error.fix, "text": str(error),
    }


def _packed(field: Float32Array, encoding: Encoding) -> tuple[bytes, float]:
    if encoding is Encoding.FLOAT32:
        return field.astype("<f4", copy=False).tobytes(), 1.0
    scale = max(_FINEST, float(np.abs(field).max(initial=0.0)) / 32767.0)
    return _padded(np.rint(field / np.float32(scale)).astype("<i2").tobytes(), b"\0"), scale


def _padded(data: bytes, by: bytes) -> bytes:
    return data + by * (-len(data) % 4)


def _forces(answer: Answer, count: int) -> tuple[AnyArray, AnyArray]:
    if answer.force is None or answer.moment is None:
        return np.full((count, 3), np.nan), np.full((count, 3), np.nan)
    return answer.force.reshape(-1, 3), answer.moment.reshape(-1, 3)


def _damaged(got: str) -> InputError:
    return InputError("frame", expected=f"a frame of protocol version {VERSION}", got=got, fix="use the same version")
