"""What a client may say: JSON in text frames, read into records and checked before anything is done."""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from mixpinn.base.arrays import FloatArray
from mixpinn.base.errors import InputError
from mixpinn.geometry.probe_pose import ProbePose
from mixpinn.server.protocol import VERSION, Encoding, Vertices
from mixpinn.serving.live.records import Friction
from mixpinn.serving.live.session import MOST_PROBES
from mixpinn.serving.live.skin import Axis

_SEE = "see the page of the live protocol"
_LARGEST = 1e5
"""No length of a message is larger [mm]."""


@dataclass(frozen=True)
class Choices:
    """What a client wants to be sent.

    Attributes:
        vertices: of the skin or all nodes.
        encoding: of the displacement.
        errors: whether the expected error of each vertex is wanted.
        friction: what friction remembers.
    """

    vertices: Vertices = Vertices.SKIN
    encoding: Encoding = Encoding.INT16
    errors: bool = False
    friction: Friction = Friction.REMEMBERED

    def as_dict(self) -> dict[str, Any]:
        """As it is said on the wire."""
        return {
            "vertices": self.vertices.name.lower(), "encoding": self.encoding.name.lower(), "errors": self.errors,
            "friction": self.friction.value,
        }


@dataclass(frozen=True, eq=False)
class Pose:
    """A probe was moved."""

    id: int
    probe: int
    pose: ProbePose


@dataclass(frozen=True, eq=False)
class OnSkin:
    """A probe is to stand on the skin; arguments of `SkinPlacement.place`."""

    id: int
    probe: int
    point: FloatArray
    depth: float
    axis: Axis
    turn_deg: float
    tilt_deg: tuple[float, float]


@dataclass(frozen=True)
class Order:
    """Anything else, with its fields checked."""

    type: str
    values: Mapping[str, Any]


Message = Pose | OnSkin | Order


def read_message(text: str) -> Message:
    """Read one message.

    Raises:
        InputError: no JSON object, an unknown type, or a field that is absent, of another type or out of range.
    """
    try:
        found = json.loads(text, parse_constant=_refuse_constant)
    except (ValueError, RecursionError) as error:
        raise _wrong("message", "a JSON object", "text that is none") from error
    if not isinstance(found, dict) or not isinstance(found.get("type"), str):
        raise _wrong("message", "a JSON object with 'type'", type(found).__name__)
    kind = found["type"]
    if kind not in _READERS:
        raise _wrong("type", "one of " + ", ".join(_READERS), _short(kind))
    return _READERS[kind](found)


def message_number(text: str | bytes) -> int | None:
    """The ``id`` of a message, if it can be made out."""
    if not isinstance(text, str):
        return None
    try:
        found = json.loads(text)
        return _id(found)
    except (ValueError, RecursionError, AttributeError, TypeError, InputError):
        return None


def read_choices(values: Mapping[str, Any], before: Choices) -> Choices:
    """Choices with what `values` changes.

    Raises:
        InputError: an unknown choice.
    """
    return Choices(
        Vertices[_word(values, "vertices", [v.name.lower() for v in Vertices], before.vertices.name.lower()).upper()],
        Encoding[_word(values, "encoding", [e.name.lower() for e in Encoding], before.encoding.name.lower()).upper()],
        _bool(values, "errors", before.errors),
        Friction(_word(values, "friction", [f.value for f in Friction], before.friction.value)),
    )


def _hello(values: Mapping[str, Any]) -> Order:
    if values.get("version") != VERSION or isinstance(values.get("version"), bool):
        raise _wrong("version", str(VERSION), _short(values.get("version")))
    return Order("hello", {"choices": read_choices(values, Choices())})


def _set(values: Mapping[str, Any]) -> Order:
    read_choices(values, Choices())
    return Order("set", dict(values))


def _pose(values: Mapping[str, Any]) -> Pose:
    place = _numbers(values, "tip", 3)
    if "quaternion" in values:
        w, x, y, z = _numbers(values, "quaternion", 4)
        size = math.sqrt(w * w + x * x + y * y + z * z)
        if not 1e-6 < size < 1e6:
            raise _wrong("quaternion", "w, x, y, z of a rotation", "a length of zero or beyond sense")
        rotation = _of_quaternion(w / size, x / size, y / size, z / size)
    else:
        rotation = np.array(_numbers(values, "rotation", 9)).reshape(3, 3)
    return Pose(_id(values), _probe(values), ProbePose(rotation, np.array(place)))


def _skin(values: Mapping[str, Any]) -> OnSkin:
    tilt = _numbers(values, "tilt_deg", 2) if "tilt_deg" in values else [0.0, 0.0]
    axis = cast(Axis, _word(values, "axis", ["pressing", "normal"], "pressing"))
    return OnSkin(
        _id(values), _probe(values), np.array(_numbers(values, "point", 3)), _number(values, "depth"), axis,
        _number(values, "turn_deg", 0.0), (tilt[0], tilt[1]),
    )


def _lift(values: Mapping[str, Any]) -> Order:
    return Order("lift", {"probe": _probe(values)})


def _record(values: Mapping[str, Any]) -> Order:
    if "on" not in values:
        raise _wrong("on", "true or false", "nothing")
    return Order("record", {"on": _bool(values, "on", False)})


def _replay(values: Mapping[str, Any]) -> Order:
    speed = _number(values, "speed", 1.0)
    if not 0.05 <= speed <= 20.0:
        raise _wrong("speed", "0.05 to 20", f"{speed:g}")
    return Order("replay", {"speed": speed})


def _save(values: Mapping[str, Any]) -> Order:
    return Order("save", {"format": _word(values, "format", ["csv", "vtu", "pvd"], None)})


def _ping(values: Mapping[str, Any]) -> Order:
    return Order("ping", {"id": _id(values)})


def _plain(kind: str) -> Callable[[Mapping[str, Any]], Order]:
    return lambda values: Order(kind, {})


_READERS: Mapping[str, Callable[[Mapping[str, Any]], Message]] = {
    "hello": _hello, "pose": _pose, "skin": _skin, "lift": _lift, "set": _set, "forget": _plain("forget"),
    "compare": _plain("compare"), "cancel": _plain("cancel"), "record": _record, "replay": _replay,
    "stop": _plain("stop"), "save": _save, "ping": _ping,
}


def _id(values: Mapping[str, Any]) -> int:
    number = values.get("id")
    if not isinstance(number, int) or isinstance(number, bool) or not 0 <= number < 2**32:
        raise _wrong("id", "a whole number from 0 to 2³² − 1", _short(number))
    return number


def _probe(values: Mapping[str, Any]) -> int:
    number = values.get("probe", 0)
    if not isinstance(number, int) or isinstance(number, bool) or not 0 <= number < MOST_PROBES:
        raise _wrong("probe", f"a whole number from 0 to {MOST_PROBES - 1}", _short(number))
    return number


def _number(values: Mapping[str, Any], name: str, default: float | None = None) -> float:
    found = values.get(name, default)
    if not _is_number(found):
        raise _wrong(name, f"a number up to {_LARGEST:g}", _short(found))
    return float(cast(float, found))


def _numbers(values: Mapping[str, Any], name: str, count: int) -> list[float]:
    found = values.get(name)
    if not isinstance(found, Sequence) or isinstance(found, str) or len(found) != count:
        raise _wrong(name, f"a list of {count} numbers", _short(found))
    if not all(map(_is_number, found)):
        raise _wrong(name, f"{count} numbers up to {_LARGEST:g}", _short(found))
    return [float(value) for value in found]


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= _LARGEST


def _bool(values: Mapping[str, Any], name: str, default: bool) -> bool:
    found = values.get(name, default)
    if not isinstance(found, bool):
        raise _wrong(name, "true or false", _short(found))
    return found


def _word(values: Mapping[str, Any], name: str, allowed: Sequence[str], default: str | None) -> str:
    found = values.get(name, default)
    if not isinstance(found, str) or found not in allowed:
        raise _wrong(name, "one of " + ", ".join(allowed), _short(found))
    return found


def _of_quaternion(w: float, x: float, y: float, z: float) -> FloatArray:
    """R of a unit quaternion w + xi + yj + zk."""
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])


def _refuse_constant(name: str) -> float:
    raise ValueError(name)


def _short(value: Any) -> str:
    text = "nothing" if value is None else ascii(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _wrong(what: str, expected: str, got: str) -> InputError:
    return InputError(what, expected=expected, got=got, fix=_SEE)
