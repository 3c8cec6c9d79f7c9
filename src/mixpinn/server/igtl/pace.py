"""How often one peer wants one type of message."""

from dataclasses import dataclass


@dataclass
class Pace:
    """The newest message at most once an interval, and always the last one in the end.

    Attributes:
        interval: between two messages [s].
        streaming: whether every answer is to be sent; otherwise only what was asked for once.
        asked: whether one was asked for.
        due: before this time nothing goes out [s].
        stale: whether an answer came that was not sent yet.
    """

    interval: float = 0.0
    streaming: bool = True
    asked: bool = False
    due: float = 0.0
    stale: bool = True

    def wanted(self) -> bool:
        """Whether something is to be sent, now or when it is due."""
        return self.asked or (self.streaming and self.stale)

    def sent(self, now: float) -> None:
        """The newest message went out."""
        self.asked = self.stale = False
        self.due = now + self.interval
