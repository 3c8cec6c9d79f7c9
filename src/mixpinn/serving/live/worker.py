"""PressWorker: threads that answer sessions in turn, each session's newest poses and nothing older."""

import logging
import threading
from collections import deque
from collections.abc import Callable
from typing import Protocol

logger = logging.getLogger(__name__)


class Waiting(Protocol):
    """Somebody who waits for a turn."""

    def take_turn(self) -> bool:
        """Answer the newest poses; whether newer ones have come meanwhile."""


class Finisher:
    """A thread that does one thing at a time: whoever brings the next one waits until the last is done."""

    def __init__(self, name: str) -> None:
        """Start."""
        self._changed = threading.Condition()
        self._task: Callable[[], None] | None = None
        self._closed = False
        self._thread = threading.Thread(target=self._serve, name=name, daemon=True)
        self._thread.start()

    def do(self, task: Callable[[], None]) -> None:
        """Have it done; returns when it begins, or at once where this was closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._task is None or self._closed)
            if not self._closed:
                self._task = task
                self._changed.notify_all()

    def close(self) -> None:
        """Stop after what is being done now."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        if self._thread is not threading.current_thread():
            self._thread.join()

    def _serve(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._task is not None or self._closed)
                task = self._task
            if self._closed or task is None:
                return
            try:
                task()
            except Exception:  # one session's fault, a listener's say, is not to silence all others
                logger.exception("a live session failed to finish an answer")
            with self._changed:
                self._task = None
                self._changed.notify_all()


class PressWorker:
    """Serves sessions in turn.

    An answer has two parts: contact, for which sessions stand in line here, and the body under it, which a `Finisher`
    computes while the next contact is being solved already.

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
        self._finishers = [Finisher(f"mixpinn-finish-{i}") for i in range(threads)]
        self._sessions = 0
        for thread in self._threads:
            thread.start()

    def finisher(self) -> Finisher:
        """For a new session: its answers are finished by the same thread, one after another."""
        with self._changed:
            self._sessions += 1
            return self._finishers[self._sessions % len(self._finishers)]

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
        for finisher in self._finishers:
            finisher.close()
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
