"""Simulations that go on in the background while what is finished is worked with."""

import threading
from collections.abc import Sequence
from typing import Any

from mixpinn.dataset.generation import PoseBar, check_request, run_poses
from mixpinn.dataset.local_pool import STEP_TIMEOUT
from mixpinn.dataset.protocol import Pose
from mixpinn.dataset.status import PoseState, PoseStatus
from mixpinn.dataset.store import SimulationStore
from mixpinn.dataset.worker import Runner


class SimulationsAhead:
    """Poses of a store that are simulated in their order, from entering the context until it is left.

    A thread sees to the worker processes; their results do not depend on what is done meanwhile. Leaving the context
    early ends them, and loses the poses in flight.

    It is used like this::

        with SimulationsAhead(scene, poses, store, workers=2) as ahead:
            ahead.wait(poses[:8])
            learn(build_sample_table(store, poses=poses[:8]))  # while the next ones are simulated
            ahead.wait(poses[8:])
    """

    def __init__(
        self, scene: Any, poses: Sequence[Pose], store: SimulationStore, *, workers: int = 1, threads: int = 1,
        runner: Runner | None = None, timeout: float = STEP_TIMEOUT,
    ) -> None:
        """Prepare; arguments and errors as for `mixpinn.dataset.generate`."""
        check_request(scene, poses, store, workers=workers, threads=threads, timeout=timeout)
        self._store, self._news, self._stop = store, threading.Condition(), threading.Event()
        self._heard: list[tuple[Pose, PoseStatus | None]] = []
        self._error: BaseException | None = None
        self._ended = False

        def work() -> None:
            try:
                run_poses(
                    scene, poses, store, self._hear, workers=workers, threads=threads, runner=runner, timeout=timeout,
                    stopped=self._stop.is_set,
                )
            except BaseException as error:  # told to whoever waits
                self._error = error
            with self._news:
                self._ended = True
                self._news.notify_all()

        self._thread = threading.Thread(target=work, name="simulations ahead", daemon=True)

    def __enter__(self) -> "SimulationsAhead":
        self._thread.start()
        return self

    def __exit__(self, kind: Any, *about: Any) -> None:
        if kind is not None:
            self._stop.set()
        self._thread.join()
        if kind is None and self._error is not None:
            raise self._error

    def _hear(self, pose: Pose, status: PoseStatus | None) -> None:
        with self._news:
            self._heard.append((pose, status))
            self._news.notify_all()

    def wait(self, poses: Sequence[Pose]) -> None:
        """Wait, behind a progress bar, until these poses have ended.

        Raises:
            InputError, MixpinnError: as `mixpinn.dataset.generate`.
        """
        wanted, told = {pose.name for pose in poses}, 0
        with self._news:
            waiting = wanted - {pose.name for pose, status in self._heard if status is not None}
        waiting -= {pose.name for pose in poses if self._store.status(pose).state is PoseState.DONE}
        with PoseBar(poses, self._store) as bar:
            while waiting:
                with self._news:
                    if told == len(self._heard) and not self._ended:
                        self._news.wait(timeout=1.0)
                    news, told = self._heard[told:], len(self._heard)
                    over = self._ended
                for pose, status in news:
                    if pose.name in waiting:
                        bar.hear(pose, status)
                        waiting -= {pose.name} if status is not None else set()
                if over and told == len(self._heard):
                    break
        if self._error is not None:
            raise self._error
