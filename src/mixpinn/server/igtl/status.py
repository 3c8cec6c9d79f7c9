"""STATUS: how a device is, as a number, a name and a sentence."""

import struct
from dataclasses import dataclass
from enum import IntEnum
from typing import ClassVar

from mixpinn.server.igtl.damaged import DamagedMessage

_LAYOUT = struct.Struct(">Hq20s")


class StatusCode(IntEnum):
    """The protocol's numbers of which this project sends some."""

    OK = 1
    UNKNOWN_ERROR = 2
    NOT_FOUND = 4
    ACCESS_DENIED = 5
    BUSY = 6
    OVERFLOW = 8
    CHECKSUM_ERROR = 9
    CONFIG_ERROR = 10
    ILLEGAL_INSTRUCTION = 12
    NOT_READY = 13
    DISABLED = 15
    SHUT_DOWN = 19


@dataclass(frozen=True)
class StatusBody:
    """A status.

    Attributes:
        code: a `StatusCode`, or another of the protocol's numbers.
        subcode: a number of the device's own.
        name: of the error, at most 20 ASCII characters.
        text: a sentence.
    """

    TYPE: ClassVar[str] = "STATUS"
    code: int
    subcode: int = 0
    name: str = ""
    text: str = ""

    def pack(self) -> bytes:
        """Numbers, name, and the sentence with a closing zero."""
        name = self.name.encode("ascii", "replace")[:20]
        return _LAYOUT.pack(self.code, self.subcode, name) + self.text.encode() + b"\0"

    @staticmethod
    def unpack(content: bytes) -> "StatusBody":
        """Read what `pack` wrote.

        Raises:
            DamagedMessage: fewer than 30 bytes.
        """
        if len(content) < _LAYOUT.size:
            raise DamagedMessage(f"STATUS has {_LAYOUT.size} bytes or more, not {len(content)}")
        code, subcode, name = _LAYOUT.unpack_from(content)
        text = content[_LAYOUT.size:].split(b"\0")[0]
        return StatusBody(code, subcode, name.split(b"\0")[0].decode("ascii", "replace"), text.decode(errors="replace"))
