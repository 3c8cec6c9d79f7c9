"""What a client may order besides poses: forget, compare, record, replay, save."""

import logging
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from mixpinn.base.errors import InputError, MixpinnError
from mixpinn.records.answer import Answer
from mixpinn.server.messages import Order
from mixpinn.server.protocol import ErrorCode, Kind, error_message
from mixpinn.server.service import Download, Service
from mixpinn.serving.live.comparison import FullSolution, Setup
from mixpinn.serving.live.export import save_series, save_table
from mixpinn.serving.live.recording import Recording, Replay
from mixpinn.serving.live.records import LiveAnswer
from mixpinn.serving.live.session import LiveSession
from mixpinn.serving.motions import motion_matrices

logger = logging.getLogger(__name__)


class Listener(Protocol):
    """Where answers to orders go; may be called from any thread."""

    def tell(self, message: dict[str, Any]) -> None:
        """Send a control message."""

    def show(self, found: LiveAnswer, kind: Kind) -> None:
        """Send an answer beside the live ones."""


class ClientOrders:
    """Carries out the orders of one client; nothing here takes longer than a moment, the rest runs in threads."""

    def __init__(self, client: Listener, session: LiveSession, service: Service) -> None:
        """Serve `client` and its session."""
        self._client, self._session, self._service = client, session, service
        self._recording: Recording | None = None
        self._replay: Replay | None = None
        self._solution: FullSolution | None = None
        self._downloads: list[Download] = []
        self._saving = threading.Lock()
        self._closed = False
        self._does: Mapping[str, Callable[[Order], None]] = {
            "lift": lambda order: session.lift(order.values["probe"]),
            "forget": lambda order: session.forget(),
            "compare": self._compare, "cancel": self._cancel, "record": self._record, "replay": self._play,
            "stop": self._stop, "save": self._save,
            "ping": lambda order: client.tell({"type": "pong", "id": order.values["id"]}),
        }

    def obey(self, order: Order) -> None:
        """Carry out an order.

        Raises:
            InputError: it makes no sense now.
        """
        if order.type not in self._does:
            raise InputError(order.type, expected="to be said once, first of all", got="it again", fix="leave it out")
        self._does[order.type](order)

    def close(self) -> None:
        """The client has gone."""
        self._closed = True
        self._stop(Order("stop", {}))
        self._cancel(Order("cancel", {}))
        if self._recording is not None:
            self._recording.close()
        for download in self._downloads:
            self._service.withdraw(download)

    def _record(self, order: Order) -> None:
        if order.values["on"]:
            self._stop(order)
            if self._recording is not None:
                self._recording.close()
            self._recording = Recording(most_bytes=self._service.limits.recorded_bytes)
            self._session.record(self._recording)
        else:
            self._session.record(None)
        kept = self._recording
        self._client.tell({
            "type": "recording", "on": bool(order.values["on"]), "frames": len(kept) if kept else 0,
            "seconds": kept.seconds if kept else 0.0, "full": kept.full if kept else False,
        })

    def _play(self, order: Order) -> None:
        recording = self._kept()
        self._stop(order)
        self._session.record(None)
        self._replay = Replay(
            recording, lambda found: self._client.show(found, Kind.REPLAY), speed=order.values["speed"],
            finished=lambda count: self._client.tell({"type": "replayed", "frames": count}),
        )

    def _stop(self, order: Order) -> None:
        if self._replay is not None:
            self._replay.stop()
            self._replay = None

    def _kept(self) -> Recording:
        if self._recording is None or not len(self._recording):
            raise InputError("recording", expected="one with answers", got="none", fix="record a session first")
        return self._recording

    def _save(self, order: Order) -> None:
        kind = order.values["format"]
        recording = self._kept() if kind != "vtu" else None
        newest = self._session.newest
        if recording is None and newest is None:
            raise InputError("save", expected="an answer", got="none yet", fix="press somewhere first")
        if not self._saving.acquire(blocking=False):
            raise InputError("save", expected="one file at a time", got="another one", fix="wait for 'saved'")
        if len(self._downloads) >= self._service.limits.saved:
            self._service.withdraw(self._downloads.pop(0))

        def write(path: Path) -> None:
            if recording is None:
                assert newest is not None
                newest.answer.save(path)
            elif kind == "csv":
                save_table(recording, path, mesh=self._service.predictor.mesh)
            else:
                save_series(recording, path)

        def work() -> None:
            said: dict[str, Any]
            try:
                name = {"csv": "recording.csv", "vtu": "deformed.vtu", "pvd": "recording.zip"}[kind]
                found = self._service.offer(name, write)
                if self._closed:
                    self._service.withdraw(found)
                    return
                self._downloads.append(found)
                said = {"type": "saved", "url": found.url, "name": name, "bytes": found.path.stat().st_size}
            except Exception as error:  # whatever it is: the client waits for a word
                said = error_message(as_input_error(error, "save"), ErrorCode.REFUSED)
            finally:
                self._saving.release()
            self._client.tell(said)  # who hears it may order the next file at once

        threading.Thread(target=work, name="mixpinn-save", daemon=True).start()

    def _compare(self, order: Order) -> None:
        newest = self._session.newest
        if newest is None:
            raise InputError("compare", expected="a probe", got="none", fix="press first")
        setup = Setup.of_predictor(self._service.predictor, [probe.pose for probe in newest.probes])
        if not self._service.comparing.acquire(blocking=False):
            self._client.tell(error_message(InputError(
                "compare", expected="one full solution at a time", got="another one that is running",
                fix="wait for it, or cancel it",
            ), ErrorCode.BUSY))
            return
        began = time.perf_counter()

        def progress(done: int, of: int) -> None:
            self._client.tell({"type": "progress", "done": done, "of": of, "seconds": time.perf_counter() - began})

        def finished(found: Answer | MixpinnError) -> None:
            try:
                self._tell_difference(newest, found, time.perf_counter() - began)
            except Exception as error:
                self._client.tell(error_message(as_input_error(error, "compare"), ErrorCode.REFUSED))
            finally:
                self._solution = None
                self._service.comparing.release()

        try:
            self._solution = FullSolution(setup, progress=progress, finished=finished)
        except BaseException:
            self._service.comparing.release()
            raise

    def _cancel(self, order: Order) -> None:
        solution, self._solution = self._solution, None
        if solution is not None and solution.cancel():
            self._service.comparing.release()

    def _tell_difference(self, newest: LiveAnswer, found: Answer | MixpinnError, seconds: float) -> None:
        if isinstance(found, MixpinnError):
            raise found
        # Both came straight: what friction remembers of the drag is no part of the difference.
        poses, began = [probe.pose for probe in newest.probes], time.perf_counter()
        mine = self._service.predictor.press(
            np.array([pose.translation for pose in poses]), rotation=np.array([pose.rotation for pose in poses]),
        )
        model_ms = 1e3 * (time.perf_counter() - began)
        apart = np.linalg.norm(mine.displacement - found.displacement[: len(mine.displacement)], axis=1)
        assert found.force is not None
        assert mine.force is not None
        mesh = self._service.predictor.mesh
        self._client.show(replace(
            newest, answer=found, matrices=motion_matrices(mesh, found.motions), seconds=seconds, remembered=False,
        ), Kind.FULL_SOLUTION)
        self._client.tell({
            "type": "comparison", "id": newest.pose_id, "mean": float(apart.mean()), "largest": float(apart.max()),
            "force": {
                "full": found.force.reshape(-1, 3).sum(axis=0).tolist(), "model": mine.force.sum(axis=0).tolist(),
            }, "seconds": seconds,
            "model_ms": model_ms, "converged": found.trust is None or found.trust.converged,
            "discretisation": found.discretisation,
        })


def as_input_error(error: Exception, what: str) -> InputError:
    """Any error as one that a client is told of; the traceback of one that is not the project's is in the log."""
    if isinstance(error, InputError):
        return error
    if not isinstance(error, MixpinnError):
        logger.error("%s failed", what, exc_info=error)
        return InputError(
            what, expected="to succeed", got=f"{type(error).__name__}: {error}",
            fix="try again, and report this with the server's log",
        )
    return InputError(what, expected="to succeed", got=str(error), fix="choose another pose, or free some memory")
