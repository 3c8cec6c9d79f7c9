"""Child processes that cannot hold up their parent: they end with it, and one that hears nothing is killed."""

import contextlib
import ctypes
import os
import signal
import sys
import time
import types
from collections.abc import Iterable, Iterator, Mapping
from typing import Generic, Protocol, TypeVar

T = TypeVar("T")
GRACE = 5.0
"""How long a process that is asked to end may take before it is killed [s]."""
_PR_SET_PDEATHSIG = 1


class Process(Protocol):
    """What `end_all` needs of a process; those of `multiprocessing` have it."""

    def terminate(self) -> None: ...

    def kill(self) -> None: ...

    def join(self, timeout: float | None = None) -> None: ...

    def is_alive(self) -> bool: ...


def end_with_parent(parent: int | None = None) -> None:
    """Have the system kill this process when the one that started it ends, however it ends; a stopped one too.

    Linux alone knows of this; elsewhere nothing happens, and a worker notices at its next message.

    Args:
        parent: number of the process that started this one, where it may have ended already.
    """
    if not sys.platform.startswith("linux"):
        return
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(signal.SIGKILL), 0, 0, 0)
    if parent is not None and os.getppid() != parent:
        os._exit(1)


def end_all(processes: Iterable[Process], *, grace: float = GRACE) -> None:
    """End processes: each is asked to, and killed where it has not ended after `grace` seconds in all."""
    processes = list(processes)
    try:
        for process in processes:
            process.terminate()
        deadline = time.monotonic() + grace
        for process in processes:
            process.join(max(0.0, deadline - time.monotonic()))
    finally:  # also when Ctrl-C comes a second time
        for process in processes:
            if process.is_alive():
                process.kill()
            process.join()


@contextlib.contextmanager
def script_left_alone() -> Iterator[None]:
    """Child processes that are spawned meanwhile do not run the script again that called this one.

    A spawned process imports the main script under another name, for the sake of what is pickled from it. A script
    without ``if __name__ == "__main__":`` would begin anew there. What is handed over must not come from the script.
    """
    main = sys.modules["__main__"]
    sys.modules["__main__"] = types.ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


class Patience(Generic[T]):
    """How long each of several has been silent, without the time in which this process was itself held up or suspended.

    Args:
        shortest: the shortest silence that counts [s].

    Attributes:
        tick: how often this process looks [s].
    """

    def __init__(self, shortest: float) -> None:
        self.tick = min(1.0, shortest / 4.0)
        self._silent: dict[T, float] = {}
        self._looked = time.monotonic()

    def heard(self, who: T) -> None:
        """`who` has given a sign of life."""
        self._silent.pop(who, None)

    def lost(self, limits: Mapping[T, float]) -> list[T]:
        """Those that have been silent for longer than they may [s]; to be called once a tick with all waited for."""
        now = time.monotonic()
        passed, self._looked = min(now - self._looked, 2.0 * self.tick), now
        self._silent = {who: self._silent.get(who, 0.0) + passed for who in limits}
        return [who for who, silent in self._silent.items() if silent > limits[who]]
