"""Questions of the protocol: one message of a type (GET_), begin to send it (STT_), end that (STP_)."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from mixpinn.server.igtl.header import TYPE_LENGTH
from mixpinn.server.igtl.message import Message
from mixpinn.server.igtl.timestamp import seconds_of


class Ask(StrEnum):
    """What is asked for, as the protocol's prefixes have it."""

    ONCE = "GET_"
    BEGIN = "STT_"
    END = "STP_"


@dataclass(frozen=True)
class Query:
    """A question about a type.

    Attributes:
        ask: what is to be done.
        kind: the type.
        interval: between two messages [s]; None where the question does not say.
    """

    ask: Ask
    kind: str
    interval: float | None = None


def read_query(message: Message, kinds: Sequence[str]) -> Query | None:
    """The question that a message is; None for any other message, and for types that are not in `kinds`.

    Twelve letters hold the prefix and eight of the type (``GET_TRANSFOR``).
    """
    for ask in Ask:
        if not message.type.startswith(ask.value):
            continue
        for kind in kinds:
            if message.type == f"{ask.value}{kind}"[:TYPE_LENGTH]:
                return Query(ask, kind, _interval(message.content) if ask is Ask.BEGIN else None)
    return None


def reply_type(kind: str) -> str:
    """Type of the message that says that a question came."""
    return f"RTS_{kind}"[:TYPE_LENGTH]


def _interval(content: bytes) -> float | None:
    """Eight bytes are a time in the protocol's format, four are milliseconds."""
    number = int.from_bytes(content, "big")
    return {8: seconds_of(number), 4: 1e-3 * number}.get(len(content))
