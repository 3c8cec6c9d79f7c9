"""A message: header, content, and with version 2 an extended header with a number and metadata around the content."""

import struct
from collections.abc import Mapping
from dataclasses import dataclass, field

from mixpinn.server.igtl.crc64 import crc64
from mixpinn.server.igtl.damaged import DamagedMessage
from mixpinn.server.igtl.header import Header

_EXTENDED = struct.Struct(">HHII")
_INDEX = struct.Struct(">HHI")
_COUNT = struct.Struct(">H")
_US_ASCII, _UTF8 = 3, 106
"""IANA's numbers (MIBenum) of the character sets in which values are written."""


@dataclass(frozen=True)
class Message:
    """What goes over the line.

    Attributes:
        type: of the content, as the protocol names it (``TRANSFORM``).
        device: what it is about.
        content: the bytes that the type defines.
        timestamp: when the data came to be, as `timestamp.ticks_of` has it; 0 where unused.
        version: of the header; number and metadata are written with version 2 only.
        number: of the message, to refer to it.
        metadata: names and values that travel along.
    """

    type: str
    device: str
    content: bytes = b""
    timestamp: int = 0
    version: int = 1
    number: int = 0
    metadata: Mapping[str, str] = field(default_factory=dict)

    def pack(self) -> bytes:
        """The whole message as bytes."""
        body = self.content
        if self.version >= 2:
            index, values = _pack_metadata(self.metadata)
            body = _EXTENDED.pack(_EXTENDED.size, len(index), len(values), self.number) + body + index + values
        return Header(self.type, self.device, self.timestamp, len(body), crc64(body), self.version).pack() + body

    @staticmethod
    def unpack(header: Header, body: bytes) -> "Message":
        """The message of a header and the body that followed it.

        Raises:
            DamagedMessage: another size or checksum than the header says, or an extended header that does not fit.
        """
        if len(body) != header.body_size:
            raise DamagedMessage(f"{header.type}: {len(body)} bytes came, {header.body_size} were announced")
        if crc64(body) != header.crc:
            raise DamagedMessage(f"{header.type} {header.device}: the checksum is wrong")
        if header.version == 1:
            return Message(header.type, header.device, body, header.timestamp)
        if len(body) < _EXTENDED.size:
            raise DamagedMessage(f"{header.type}: {len(body)} bytes are too few for an extended header")
        size, index_size, values_size, number = _EXTENDED.unpack_from(body)
        end = len(body) - index_size - values_size
        if size < _EXTENDED.size or end < size:
            raise DamagedMessage(f"{header.type}: the extended header's sizes do not fit the body")
        metadata = _unpack_metadata(body[end:end + index_size], body[end + index_size:])
        return Message(header.type, header.device, body[size:end], header.timestamp, header.version, number, metadata)


def _pack_metadata(metadata: Mapping[str, str]) -> tuple[bytes, bytes]:
    index, values = [_COUNT.pack(len(metadata))], []
    for name, value in metadata.items():
        key, text = name.encode("ascii", "replace"), value.encode()
        index.append(_INDEX.pack(len(key), _US_ASCII if value.isascii() else _UTF8, len(text)))
        values += [key, text]
    return b"".join(index), b"".join(values)


def _unpack_metadata(index: bytes, values: bytes) -> dict[str, str]:
    if not index:
        return {}
    if len(index) < _COUNT.size:
        raise DamagedMessage("the metadata's index is cut off")
    count = _COUNT.unpack_from(index)[0]
    if len(index) != _COUNT.size + count * _INDEX.size:
        raise DamagedMessage(f"the metadata's index does not hold the {count} entries that it announces")
    found, at = {}, 0
    for key_size, _, value_size in _INDEX.iter_unpack(index[_COUNT.size:]):
        middle, end = at + key_size, at + key_size + value_size
        if end > len(values):
            raise DamagedMessage("the metadata are cut off")
        found[values[at:middle].decode("ascii", "replace")] = values[middle:end].decode("utf-8", "replace")
        at = end
    return found
