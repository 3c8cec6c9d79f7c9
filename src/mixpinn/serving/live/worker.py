"""PressWorker: threads that answer sessions in turn, each session's newest poses and nothing older."""

import logging
import threading
from collections import deque
from typing import Protocol

logger = logging.getLogger(__name__)


class Waiting(Protocol):
    """Somebody who waits for a turn."""

    def take_turn(self) -> bool:
        """Answer the newest poses; whether newer ones have come meanwhile."""


class PressWorker:
    """Serves sessions in turn.

    A session stands in the line at most once, however many poses came, and no two threads serve it at the same time.
    Whoever has been served stands behind all others that wait: none holds up another for longer than one answer.
    """

    def __init__(self, threads: int = 1) -> None:
        """Start.

        Args:
            threads: how many sessions are answered at the same time.
        """
        self._changed = threading.Condition()
        self._line: deque[Waiting] = deque()
        self._known: set[int] = set()
        self._again: set[int] = set()
        self._closed = False
        self._threads = [
            threading.Thread(target=self._serve, name=f"mixpinn-press-{i}", daemon=True) for i in range(threads)
        ]
        for thread in self._threads:
            thread.start()

    def wake(self, session: Waiting) -> None:
        """Give `session` a turn; nothing happens where it already waits or is being served."""
        with self._changed:
            if self._closed:
                return
            if id(session) in self._known:
                self._again.add(id(session))
                return
            self._known.add(id(session))
            self._line.append(session)
            self._changed.notify()

    def close(self) -> None:
        """Stop after what is being answered now."""
        with self._changed:
            self._closed = True
            self._line.clear()
            self._changed.notify_all()
        for thread in self._threads:
            if thread is not threading.current_thread():
                thread.join()

    def _serve(self) -> None:
        while True:
            with self._changed:
                while not self._line and not self._closed:
                    self._changed.wait()
                if self._closed:
                    return
                session = self._line.popleft()
                self._again.discard(id(session))
            more = False
            try:
                more = session.take_turn()
            except Exception:  # one session's fault, a listener's say, is not to silence all others
                logger.exception("a live session failed to take its turn")
            finally:
                with self._changed:
                    if (more or id(session) in self._again) and not self._closed:
                        self._line.append(session)
                        self._changed.notify()
                    else:
                        self._known.discard(id(session))
