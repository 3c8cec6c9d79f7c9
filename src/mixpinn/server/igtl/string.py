"""STRING: a text with the number of its character set."""

import struct
from dataclasses import dataclass
from typing import ClassVar

from mixpinn.server.igtl.damaged import DamagedMessage

_LAYOUT = struct.Struct(">HH")
_CODECS = {3: "ascii", 4: "latin-1", 106: "utf-8"}
"""By IANA's number (MIBenum) of the character set."""
_LONGEST = 65535


@dataclass(frozen=True)
class StringBody:
    """A text; ASCII is written as such, anything else as UTF-8.

    Attributes:
        text: at most 65,535 bytes when written.
    """

    TYPE: ClassVar[str] = "STRING"
    text: str

    def pack(self) -> bytes:
        """Character set, length and text.

        Raises:
            ValueError: a longer text than the protocol can say.
        """
        data = self.text.encode()
        if len(data) > _LONGEST:
            raise ValueError(f"STRING holds {_LONGEST} bytes at most, not {len(data)}")
        return _LAYOUT.pack(3 if self.text.isascii() else 106, len(data)) + data

    @staticmethod
    def unpack(content: bytes) -> "StringBody":
        """Read what `pack` wrote.

        Raises:
            DamagedMessage: fewer bytes than announced, or a character set that is not known here.
        """
        if len(content) < _LAYOUT.size:
            raise DamagedMessage(f"STRING has 4 bytes or more, not {len(content)}")
        encoding, length = _LAYOUT.unpack_from(content)
        data = content[_LAYOUT.size:]
        if len(data) != length:
            raise DamagedMessage(f"STRING: {len(data)} bytes came, {length} were announced")
        if encoding not in _CODECS:
            raise DamagedMessage(f"STRING: character set {encoding} is not known here")
        return StringBody(data.decode(_CODECS[encoding], "replace"))
