"""Recording: what a session answered, kept on disk while it runs, to be played again or saved."""

import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from mixpinn.base.errors import InputError
from mixpinn.serving.live.records import LiveAnswer

_MOST_FRAMES = 20_000
_NOTHING = np.zeros((0, 3), dtype=np.float32)


class Recording:
    """Answers in the order in which they came. Displacements lie in a nameless temporary file, the rest in memory.

    Attributes:
        full: whether answers were left out for want of room.
    """

    def __init__(self, *, most_bytes: int = 1_000_000_000) -> None:
        """Begin.

        Args:
            most_bytes: of displacements; what comes beyond is left out.
        """
        self._most, self._lock = most_bytes, threading.Lock()
        self._spool = tempfile.TemporaryFile()  # noqa: SIM115 (closed by `close`)
        self._frames: list[LiveAnswer] = []
        self._closed, self.full = False, False

    def add(self, found: LiveAnswer) -> bool:
        """Keep an answer; false where there is no room."""
        field = np.ascontiguousarray(found.answer.displacement, dtype=np.float32)
        with self._lock:
            if self._closed:
                return False
            if (len(self._frames) + 1) * field.nbytes > self._most or len(self._frames) >= _MOST_FRAMES:
                self.full = True
                return False
            try:
                self._spool.seek(len(self._frames) * field.nbytes)
                self._spool.write(field.tobytes())
            except OSError:
                self.full = True
                return False
            slim = replace(found.answer, displacement=_NOTHING, history=None, contact=None)
            self._frames.append(replace(found, answer=slim))
        return True

    def __len__(self) -> int:
        return len(self._frames)

    def __getitem__(self, index: int) -> LiveAnswer:
        with self._lock:
            if self._closed:
                raise InputError("recording", expected="an open one", got="one that was closed", fix="record again")
            slim = self._frames[index]
            size = 12 * slim.answer.mesh.n_nodes
            self._spool.seek(range(len(self._frames))[index] * size)
            field = np.frombuffer(self._spool.read(size), dtype=np.float32).reshape(-1, 3)
        return replace(slim, answer=replace(slim.answer, displacement=field))

    def __iter__(self) -> Iterator[LiveAnswer]:
        for index in range(len(self)):
            yield self[index]

    @property
    def seconds(self) -> float:
        """From the first answer to the last [s]."""
        return self._frames[-1].time - self._frames[0].time if self._frames else 0.0

    def close(self) -> None:
        """Give the room back."""
        with self._lock:
            self._closed = True
            self._spool.close()


class Replay:
    """Plays a recording to a listener, in its own time."""

    def __init__(
        self, recording: Recording, listener: Callable[[LiveAnswer], None], *, speed: float = 1.0,
        finished: Callable[[int], None] | None = None,
    ) -> None:
        """Begin.

        Args:
            recording: what to play.
            listener: called with each answer, from a thread of its own.
            speed: 2 plays twice as fast.
            finished: called with the number of answers that were played.
        """
        self._recording, self._listener, self._speed, self._finished = recording, listener, speed, finished
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._play, name="mixpinn-replay", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End it early."""
        self._stop.set()

    def wait(self, timeout: float | None = None) -> bool:
        """Wait for its end; whether it has ended."""
        self._thread.join(timeout)
        return not self._thread.is_alive()

    def _play(self) -> None:
        played, began, first = 0, time.perf_counter(), 0.0
        try:
            for index in range(len(self._recording)):
                frame = self._recording[index]
                first = frame.time if index == 0 else first
                due = began + (frame.time - first) / self._speed
                if self._stop.wait(max(0.0, due - time.perf_counter())):
                    break
                self._listener(replace(frame, replayed=True))
                played += 1
        except InputError:
            pass  # the recording was given up meanwhile
        if self._finished is not None:
            self._finished(played)
