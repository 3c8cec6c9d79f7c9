"""Limits of a server: what a client may send, how often, and how long it may be silent."""

from dataclasses import dataclass

ABORT = "mixpinn.abort"
"""Where a scope's extensions have what ends the connection at once, whatever is still to be sent."""


@dataclass(frozen=True)
class Limits:
    """Chosen so that no client of good will meets them.

    Attributes:
        clients: live clients at the same time; who has been silent longest makes room for a new one.
        connections: open connections of all kinds; more are closed as they come.
        message_bytes: of one message; a larger one ends the connection.
        rate, burst: messages a second in the long run and at once; who exceeds it is disconnected.
        bad_messages: messages that cannot be read before the connection is closed.
        hello_s: until the first message [s].
        request_s: until the head of a request is complete [s].
        send_s: a client that does not take a frame for so long is disconnected [s].
        may_leave_s: a silent client makes room for another one after this time [s].
        recorded_bytes: of one recording on disk.
        saved: files that one client may have ready for download.
    """

    clients: int = 16
    connections: int = 256
    message_bytes: int = 65_536
    rate: float = 2_000.0
    burst: float = 4_000.0
    bad_messages: int = 20
    hello_s: float = 5.0
    request_s: float = 10.0
    send_s: float = 10.0
    may_leave_s: float = 60.0
    recorded_bytes: int = 1_000_000_000
    saved: int = 8


class Bucket:
    """Lets through `burst` at once and `rate` a second in the long run."""

    def __init__(self, rate: float, burst: float, now: float) -> None:
        self._rate, self._burst, self._left, self._then = rate, burst, burst, now

    def take(self, now: float) -> bool:
        """Whether one more is let through at the time `now` [s]."""
        self._left = min(self._burst, self._left + self._rate * (now - self._then))
        self._then = now
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True
