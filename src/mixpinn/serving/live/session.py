"""LiveSession: a body under probes that move; the newest poses are answered, older ones are passed over."""

import contextlib
import logging
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from mixpinn.base.errors import InputError
from mixpinn.geometry.probe_pose import ProbePose
from mixpinn.press.hurried import HurriedContact, LostTrackError
from mixpinn.press.model import PoseModel, Touch
from mixpinn.press.records import ContactHistory, check_poses
from mixpinn.records.answer import Answer, Contact, Motion, Source, Trust
from mixpinn.serving.hybrid_predictor import HybridPredictor
from mixpinn.serving.live.recording import Recording
from mixpinn.serving.live.records import Friction, LiveAnswer, LiveProbe, Refusal
from mixpinn.serving.live.skin import SkinPlacement
from mixpinn.serving.live.worker import PressWorker
from mixpinn.serving.load import AnyPredictor, load_predictor
from mixpinn.serving.motions import centroids, motion_matrices

logger = logging.getLogger(__name__)

Listener = Callable[[LiveAnswer | Refusal], None]
MOST_PROBES = 4
"""Probes of one session."""
_JUMP, _TURN = 20.0, 20.0
"""Friction forgets the way where a probe jumps by more than this [mm] or turns by more than this [degree] at once."""


def _as_refusal(error: Exception) -> InputError:
    """What a client is told: a mistake of the input as it is, another error by its kind, its traceback in the log."""
    if isinstance(error, InputError):
        return error
    logger.error("a pose could not be answered", exc_info=error)
    return InputError(
        "answer", expected="a pose that can be answered", got=f"{type(error).__name__}: {error}",
        fix="press elsewhere, and report this with the server's log",
    )


class LiveSession:
    """The state of one body: where its probes are, what friction remembers, and the newest answer.

    Poses may come from any thread and at any rate. Of each probe only the newest is kept; a worker answers it when the
    session has its turn, with all probes pressing at the same time. Listeners are called from a thread of the worker.

    Attributes:
        predictor: what answers.
        skin: from places on the skin to poses.
        friction: whether friction remembers the way of the probes; may be changed at any time.

    Example:
        >>> with LiveSession.open("runs/hybrid") as session:
        ...     back = session.predictor.mesh.points[:, 1].max()
        ...     pose = session.skin.place((0.0, back, 0.0), depth=2.0)
        ...     found = session.press(pose, pose_id=7)
        >>> found.pose_id, round(found.probes[0].depth, 3)
        (7, 2.0)
    """

    def __init__(
        self, predictor: AnyPredictor, *, worker: PressWorker | None = None, friction: Friction = Friction.REMEMBERED,
    ) -> None:
        """Begin, with no probe.

        Args:
            predictor: a hybrid model that takes poses.
            worker: shared with other sessions; by default one of its own.
            friction: whether friction remembers the way of the probes.

        Raises:
            InputError: a network, or a bundle without contact from the pose.
        """
        self.predictor = checked_predictor(predictor)
        self._model = self.predictor.pressing
        self._hurried = replace(self._model, contact=HurriedContact.of(self._model.contact))
        self._centres = centroids(self.predictor.mesh)
        self.skin, self.friction = SkinPlacement(self._model), Friction(friction)
        self._worker, self._owns_worker = worker or PressWorker(), worker is None
        self._finisher = self._worker.finisher()
        self._changed = threading.Condition()
        self._probes: dict[int, LiveProbe] = {}
        self._dirty, self._closed, self._forget = False, False, False
        self._listeners: list[Listener] = []
        self._newest: LiveAnswer | None = None
        self._last: LiveAnswer | Refusal | None = None
        self._last_asked, self._next_id, self._sequence = 0.0, 1, 0
        self._history: tuple[tuple[LiveProbe, ...], ContactHistory] | None = None
        self._recording: Recording | None = None
        self._began = time.perf_counter()

    @staticmethod
    def open(bundle: Path | str, *, friction: Friction = Friction.REMEMBERED) -> "LiveSession":
        """A session of the bundle in a folder.

        Raises:
            InputError: the folder is incomplete or damaged, a network, or a bundle without contact from the pose.
        """
        return LiveSession(load_predictor(bundle), friction=friction)

    @property
    def newest(self) -> LiveAnswer | None:
        """The newest answer, if there is one."""
        return self._newest

    def listen(self, listener: Listener) -> Callable[[], None]:
        """Have `listener` called with every answer or refusal; what is returned ends that."""
        with self._changed:
            self._listeners.append(listener)

        def leave() -> None:
            with self._changed:
                if listener in self._listeners:
                    self._listeners.remove(listener)

        return leave

    def move(self, pose: ProbePose, *, probe: int = 0, pose_id: int | None = None) -> int:
        """Say where a probe is; returns at once.

        Args:
            pose: of the probe.
            probe: index of it; one that was not there yet comes straight down its axis.
            pose_id: number to be named by the answer; by default the next one.

        Returns:
            The pose's number.

        Raises:
            InputError: a pose that is not finite or no rotation, an impossible probe, or a session that was closed.
        """
        if not 0 <= probe < MOST_PROBES:
            raise InputError(
                "probe", expected=f"an index from 0 to {MOST_PROBES - 1}", got=str(probe), fix="use fewer probes",
            )
        turns, places = check_poses(1, np.asarray(pose.rotation)[None], np.asarray(pose.translation)[None])
        with self._changed:
            self._refuse_closed()
            number = self._next_id if pose_id is None else pose_id
            self._next_id = number + 1
            self._probes[probe] = LiveProbe(probe, number, ProbePose(turns[0], places[0]), time.perf_counter())
            self._dirty = True
        self._worker.wake(self)
        return number

    def lift(self, probe: int = 0) -> None:
        """Take a probe away.

        Raises:
            InputError: the session was closed.
        """
        with self._changed:
            self._refuse_closed()
            if self._probes.pop(probe, None) is None:
                return
            self._dirty = True
        self._worker.wake(self)

    def forget(self) -> None:
        """The next answer is that of probes that came straight along their axes.

        Raises:
            InputError: the session was closed.
        """
        with self._changed:
            self._refuse_closed()
            self._forget = self._dirty = True
        self._worker.wake(self)

    def press(
        self, pose: ProbePose, *, probe: int = 0, pose_id: int | None = None, timeout: float = 60.0,
    ) -> LiveAnswer:
        """Move a probe and wait for an answer that knows of it; arguments of `move`.

        Raises:
            InputError: as `move`, a pose beyond sense, or no answer within `timeout` seconds.
        """
        asked = time.perf_counter()
        number = self.move(pose, probe=probe, pose_id=pose_id)
        with self._changed:
            if not self._changed.wait_for(lambda: self._last_asked >= asked or self._closed, timeout):
                raise InputError(
                    "pose", expected=f"an answer within {timeout:g} s", got="none", fix="give it more time",
                )
            last = self._last
        if isinstance(last, Refusal):
            raise last.error
        if last is None or self._closed:
            raise _closed()
        assert last.pose_id >= number or pose_id is not None
        return last

    @property
    def recording(self) -> Recording | None:
        """What is being recorded, or None."""
        return self._recording

    def record(self, recording: Recording | None) -> None:
        """Keep every answer in `recording` from now on; None ends that."""
        with self._changed:
            self._recording = recording

    def close(self) -> None:
        """End it; listeners are not called any more. A recording stays with whoever made it."""
        with self._changed:
            self._closed, self._dirty, self._recording = True, False, None
            self._listeners.clear()
            self._changed.notify_all()
        if self._owns_worker:
            self._worker.close()

    def __enter__(self) -> "LiveSession":
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def take_turn(self) -> bool:
        """Answer the newest poses (called by the worker); whether newer ones have come meanwhile."""
        with self._changed:
            if self._closed or not self._dirty:
                return False
            probes = tuple(self._probes[index] for index in sorted(self._probes))
            self._dirty = False
            if self._forget:
                self._history, self._forget = None, False
            self._sequence += 1
            sequence = self._sequence
        began = time.perf_counter()
        asked = max((probe.asked for probe in probes), default=began)
        touch: tuple[Touch, bool] | None = None
        failed: Exception | None = None
        try:
            touch = self._touch(probes)
        except Exception as error:  # an error that nobody foresaw must not end the thread that serves all others
            self._history, failed = None, error
        taken = time.perf_counter() - began

        def finish() -> None:
            found: LiveAnswer | Refusal
            try:
                if failed is not None:
                    raise failed
                found = self._answer(probes, touch, sequence, taken)
            except Exception as error:
                newest = max(probes, key=lambda probe: probe.asked, default=None)
                found = Refusal(0 if newest is None else newest.pose_id, _as_refusal(error))
            self._deliver(found, asked)

        self._finisher.do(finish)
        with self._changed:
            return self._dirty and not self._closed

    def _deliver(self, found: LiveAnswer | Refusal, asked: float) -> None:
        with self._changed:
            if self._closed:
                return
            if isinstance(found, LiveAnswer):
                self._newest = found
            self._last, self._last_asked = found, asked
            listeners, recording = tuple(self._listeners), self._recording
            self._changed.notify_all()
        if recording is not None and isinstance(found, LiveAnswer) and not recording.add(found):
            self._recording = None
        for listener in listeners:
            listener(found)

    def _answer(
        self, probes: tuple[LiveProbe, ...], touch: tuple[Touch, bool] | None, sequence: int, taken: float,
    ) -> LiveAnswer:
        """The second part of an answer: the body under a contact, which took `taken` seconds."""
        began = time.perf_counter()
        if touch is None:
            answer, remembered = untouched(self._model, self.predictor.name), False
        else:
            contact, remembered = touch
            answer = self.predictor.answer_of(self._model.deform(contact))
            probes = tuple(
                replace(probe, depth=float(depth))
                for probe, depth in zip(probes, contact.contact.depths, strict=True)
            )
        matrices = motion_matrices(self.predictor.mesh, answer.motions, centres=self._centres)
        done = time.perf_counter()
        return LiveAnswer(sequence, probes, answer, matrices, done - self._began, taken + done - began, remembered)

    def _touch(self, probes: tuple[LiveProbe, ...]) -> tuple[Touch, bool] | None:
        """The first part of an answer, contact, and whether friction remembered the way; None without probes."""
        if not probes:
            self._history = None
            return None
        touch, remembered = self._ask(probes, self._usable_history(probes))
        # Where contact did not converge nobody knows where the skin was gripped: the next answer comes straight.
        self._history = (probes, touch.contact.history) if touch.contact.converged else None
        return touch, remembered

    def _ask(self, probes: tuple[LiveProbe, ...], history: ContactHistory | None) -> tuple[Touch, bool]:
        """A drag that cannot be followed is given up soon, for the straight way down; that is as patient as ever."""
        tips = np.array([probe.pose.translation for probe in probes])
        rotations = np.array([probe.pose.rotation for probe in probes])
        chosen = [0] * len(probes)
        if history is not None:
            with contextlib.suppress(LostTrackError):
                touch = self._hurried.touch(rotations, tips, probes=chosen, history=history)
                if touch.contact.converged:
                    return touch, True
        return self._model.touch(rotations, tips, probes=chosen), False

    def _usable_history(self, probes: tuple[LiveProbe, ...]) -> ContactHistory | None:
        """What friction remembers, unless other probes press now or one jumped."""
        if self._history is None or self.friction is not Friction.REMEMBERED:
            return None
        before, history = self._history
        if [probe.index for probe in before] != [probe.index for probe in probes]:
            return None
        for old, new in zip(before, probes, strict=True):
            cosine = 0.5 * (np.trace(old.pose.rotation.T @ new.pose.rotation) - 1.0)
            far = np.linalg.norm(new.pose.translation - old.pose.translation) > _JUMP
            if far or cosine < np.cos(np.deg2rad(_TURN)):
                return None
        return history

    def _refuse_closed(self) -> None:
        if self._closed:
            raise _closed()


def checked_predictor(predictor: AnyPredictor) -> HybridPredictor:
    """The predictor, if it is one that can press.

    Raises:
        InputError: a network.
    """
    if not isinstance(predictor, HybridPredictor):
        raise InputError(
            predictor.name, expected="a hybrid bundle, which takes the probe's pose",
            got="a network, which takes contact displacements and cannot press", fix="train with --model hybrid",
        )
    return predictor


def untouched(model: PoseModel, name: str) -> Answer:
    """Nothing presses: nothing moves. Forces are (0, 3)."""
    mesh = model.hybrid.mesh
    still = Motion(np.zeros(3), np.zeros(3), np.eye(3))
    return Answer(
        mesh, np.zeros((mesh.n_nodes, 3), dtype=np.float32), Source.HYBRID_POSE, model=name, force=np.zeros((0, 3)),
        moment=np.zeros((0, 3)), motions=dict.fromkeys(mesh.rigid_names, still),
        contact=Contact(np.zeros(0, dtype=np.int64), np.zeros((0, 3)), np.zeros((0, 3))),
        trust=Trust(
            0.0, 0.0, 1.0, force_expected=0.0, force_bound=0.0, motion_expected=0.0, motion_bound=0.0,
            reasons=("no probe presses: nothing moves",),
        ),
        discretisation=model.hybrid.made_on,
    )


def _closed() -> InputError:
    return InputError("session", expected="one that goes on", got="one that was closed", fix="open another")
