"""Service: what all clients of a server share: the bundle, the threads that answer, and the room that there is."""

import secrets
import threading
import time
import weakref
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from mixpinn.base.scratch_folder import scratch_folder
from mixpinn.server.limits import Limits
from mixpinn.server.scene import SceneFiles
from mixpinn.serving.hybrid_predictor import HybridPredictor
from mixpinn.serving.live.session import checked_predictor
from mixpinn.serving.live.worker import PressWorker
from mixpinn.serving.load import AnyPredictor


class Guest(Protocol):
    """A live client, as the service sees it."""

    heard: float
    """When it last said something, by `time.monotonic`."""

    def leave(self) -> None:
        """Make room for another one."""


@dataclass(frozen=True)
class Download:
    """A file that is ready for one client.

    Attributes:
        path: where it lies.
        name: what it is to be called.
        key: that its address holds.
    """

    path: Path
    name: str
    key: str

    @property
    def url(self) -> str:
        """Path of its address."""
        return f"/download/{self.key}/{self.name}"


class Service:
    """Shared by all clients.

    Attributes:
        predictor: what answers.
        scene: what is sent to every client alike.
        worker: answers sessions in turn.
        limits: of clients.
    """

    def __init__(self, predictor: AnyPredictor, *, limits: Limits | None = None, threads: int = 1) -> None:
        """Prepare.

        Args:
            predictor: a hybrid model that takes poses.
            limits: of clients.
            threads: sessions that are answered at the same time.

        Raises:
            InputError: a network, or a bundle without contact from the pose.
        """
        self.predictor: HybridPredictor = checked_predictor(predictor)
        self.predictor.read_ahead()
        self.scene = SceneFiles.of_predictor(self.predictor)
        self.limits, self.worker = limits or Limits(), PressWorker(threads)
        self.comparing = threading.Lock()
        self._guests: set[Guest] = set()
        self._downloads: dict[str, Download] = {}
        opened = ExitStack()
        self._folder = opened.enter_context(scratch_folder())
        self._remove_folder = weakref.finalize(self, opened.close)
        self.sessions = 0

    def admit(self, guest: Guest) -> bool:
        """Whether there is room for one more; whoever has been silent for long makes room."""
        if len(self._guests) >= self.limits.clients:
            silent = min(self._guests, key=lambda one: one.heard)
            if time.monotonic() - silent.heard < self.limits.may_leave_s:
                return False
            self._guests.discard(silent)
            silent.leave()
        self._guests.add(guest)
        self.sessions += 1
        return True

    def dismiss(self, guest: Guest) -> None:
        """A client has gone."""
        self._guests.discard(guest)

    @property
    def clients(self) -> int:
        """How many live clients there are."""
        return len(self._guests)

    def offer(self, name: str, write: Callable[[Path], None]) -> Download:
        """Write a file that a client may fetch under an address that nobody can guess.

        Raises:
            InputError: it cannot be written.
        """
        key = secrets.token_urlsafe(24)
        path = self._folder / key / name
        write(path)
        self._downloads[key] = Download(path, name, key)
        return self._downloads[key]

    def download(self, key: str, name: str) -> Download | None:
        """The file of an address, if there is one."""
        found = self._downloads.get(key)
        return found if found is not None and found.name == name else None

    def withdraw(self, download: Download) -> None:
        """A file is not wanted any more."""
        self._downloads.pop(download.key, None)
        download.path.unlink(missing_ok=True)

    def close(self) -> None:
        """Stop answering."""
        self.worker.close()
        self._remove_folder()
