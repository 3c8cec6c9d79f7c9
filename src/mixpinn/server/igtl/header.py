"""The 58 bytes before every message: version, type, device, time, size and checksum of the body."""

import struct
from dataclasses import dataclass

from mixpinn.server.igtl.damaged import UnusablePeer

HEADER_SIZE = 58
TYPE_LENGTH, DEVICE_LENGTH = 12, 20
_LAYOUT = struct.Struct(">H12s20sQQQ")
VERSIONS = (1, 2)
"""Of the header: 1 for a body of content alone, 2 for one with an extended header and metadata."""


@dataclass(frozen=True)
class Header:
    """The header of one message.

    Attributes:
        type: of the body, at most 12 ASCII characters.
        device: what the body is about, at most 20 ASCII characters.
        timestamp: when the data came to be, as `timestamp.ticks_of` has it; 0 where unused.
        body_size: of what follows [byte].
        crc: checksum of what follows.
        version: one of `VERSIONS`.
    """

    type: str
    device: str
    timestamp: int
    body_size: int
    crc: int
    version: int = 1

    def pack(self) -> bytes:
        """The header as bytes; names that are too long are cut, other letters than ASCII become '?'."""
        return _LAYOUT.pack(
            self.version, _ascii(self.type, TYPE_LENGTH), _ascii(self.device, DEVICE_LENGTH), self.timestamp,
            self.body_size, self.crc,
        )

    @staticmethod
    def unpack(data: bytes) -> "Header":
        """Read what `pack` wrote.

        Raises:
            UnusablePeer: not 58 bytes, an unknown version, or a type that is no name: where the next message begins is
                unknown then.
        """
        if len(data) != HEADER_SIZE:
            raise UnusablePeer(f"a header has {HEADER_SIZE} bytes, not {len(data)}")
        version, kind, device, timestamp, body_size, crc = _LAYOUT.unpack(data)
        if version not in VERSIONS:
            raise UnusablePeer(f"headers have version 1 or 2, not {version}")
        name = kind.split(b"\0")[0]
        if not name or not all(33 <= letter < 127 for letter in name):
            raise UnusablePeer(f"a message's type is a name of ASCII letters, not {kind!r}")
        return Header(
            name.decode("ascii"), device.split(b"\0")[0].decode("ascii", "replace"), timestamp, body_size, crc, version,
        )


def _ascii(name: str, length: int) -> bytes:
    return name.encode("ascii", "replace")[:length]
