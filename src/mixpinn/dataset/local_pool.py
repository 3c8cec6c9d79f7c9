"""Local pool: worker processes of this machine, of which each may die or stop without harm to the others."""

import contextlib
import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from multiprocessing.reduction import ForkingPickler
from typing import Any, NamedTuple

from mixpinn.base.child_process import Patience, end_all, script_left_alone
from mixpinn.base.errors import InputError, MixpinnError
from mixpinn.dataset.protocol import Pose
from mixpinn.dataset.status import PoseState, PoseStatus
from mixpinn.dataset.store import SimulationStore
from mixpinn.dataset.worker import Runner, serve

THREAD_VARIABLES = (
    "OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS", "VECLIB_MAXIMUM_THREADS",
)
MAX_ATTEMPTS = 2
"""A pose whose worker died is tried once more: the machine may have been short of memory."""
MAX_LOST_STARTS = 3
"""So many workers in a row may end before they can work."""
STEP_TIMEOUT = 1800.0
"""By default a worker that finishes no step for so long is ended [s]."""
START_TIMEOUT = 600.0
"""A worker that has not imported the package by then is ended [s]."""


class Event(NamedTuple):
    """News of a pose: a step computed (`status` None) or the pose finished."""

    pose: Pose
    status: PoseStatus | None


@dataclass(eq=False)
class _Worker:
    process: Any
    connection: Connection
    started: bool = False
    ready: bool = False
    job: tuple[Pose, int] | None = None


@contextlib.contextmanager
def pinned_threads(threads: int) -> Iterator[None]:
    """Set the thread counts that child processes inherit; libraries read them when they are imported."""
    before = {name: os.environ.get(name) for name in THREAD_VARIABLES}
    os.environ.update(dict.fromkeys(THREAD_VARIABLES, str(threads)))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


@contextlib.contextmanager
def deaf_to_interrupts() -> Iterator[None]:
    """Child processes started meanwhile do not hear Ctrl-C: their parent does, and ends them without a traceback."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def hear_interrupts() -> None:
    """The opposite, for a process that was started so and deals with Ctrl-C itself."""
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


def run_local(
    store: SimulationStore, scene: Any, runner: Runner, poses: Sequence[Pose], *, workers: int, threads: int,
    timeout: float = STEP_TIMEOUT, start_timeout: float = START_TIMEOUT,
    stopped: Callable[[], bool] = lambda: False,
) -> Generator[Event, None, None]:
    """Simulate `poses` in `workers` processes of `threads` threads each; yield news as it comes.

    Which worker computes a pose, and when, has no influence on its result: nothing is handed from pose to pose.
    A worker that dies, that finishes no step within `timeout` seconds, or does not start within `start_timeout`, costs
    the attempt at its pose in flight; a new worker takes its place. However the iteration ends, all workers are ended;
    it ends early once `stopped` says so.

    Raises:
        InputError: the store cannot be written.
        MixpinnError: workers cannot even start.
    """
    pool = _Pool(store, scene, runner, poses, threads=threads, timeout=timeout, start_timeout=start_timeout)
    try:
        while not stopped() and (pool.queue or any(worker.job for worker in pool.workers)):
            pool.fill(workers)
            for connection in wait([worker.connection for worker in pool.workers], timeout=pool.patience.tick):
                yield from pool.listen(next(item for item in pool.workers if item.connection is connection))
            yield from pool.give_up()
            pool.hand_out()
    finally:
        pool.close()


@dataclass
class _Pool:
    """Workers, and what is left to do."""

    store: SimulationStore
    scene: Any
    runner: Runner
    poses: Sequence[Pose]
    threads: int
    timeout: float
    start_timeout: float
    workers: list[_Worker] = field(default_factory=list)
    lost_starts: int = 0

    def __post_init__(self) -> None:
        self.queue: deque[tuple[Pose, int]] = deque((pose, 1) for pose in self.poses)
        self.patience: Patience[_Worker] = Patience(min(self.timeout, self.start_timeout))
        self._context = multiprocessing.get_context("spawn")
        self._task = ForkingPickler.dumps((self.store, self.scene, self.runner))
        # A material of the user's own may stand in the script itself; then, alone, the workers must import it.
        self._needs_script = b"__main__" in bytes(self._task)

    def fill(self, workers: int) -> None:
        """Start as many workers as there is work for."""
        busy = sum(worker.job is not None for worker in self.workers)
        while len(self.workers) < min(workers, busy + len(self.queue)):
            here, there = self._context.Pipe()
            # What it works on goes through its connection: a process that stops while it starts cannot hold us up.
            process = self._context.Process(target=serve, args=(there, os.getpid()), daemon=True)
            script = contextlib.nullcontext() if self._needs_script else script_left_alone()
            with pinned_threads(self.threads), deaf_to_interrupts(), script:
                process.start()
            there.close()  # so that the end of the worker shows as the end of the pipe
            self.workers.append(_Worker(process, here))

    def hand_out(self) -> None:
        """Give each idle worker a pose."""
        for worker in self.workers:
            if self.queue and worker.ready and worker.job is None:
                worker.job = self.queue.popleft()
                # A worker that died between two poses shows as the end of its pipe in the next round.
                with contextlib.suppress(OSError):
                    worker.connection.send(worker.job)

    def listen(self, worker: _Worker) -> Iterator[Event]:
        """Take one message of a worker."""
        try:
            kind, content = worker.connection.recv()
        except (EOFError, OSError):
            worker.process.join()
            attempts = worker.job[1] if worker.job else 1
            times = f"{attempts} times, the last time " if attempts > 1 else ""
            yield from self._bury(worker, f"its worker process died {times}with code {worker.process.exitcode}")
            return
        self.patience.heard(worker)
        if kind == "started":
            worker.started = True
            threading.Thread(target=_send, args=(worker.connection, self._task), daemon=True).start()
        elif kind == "ready":
            worker.ready, self.lost_starts = True, 0
        elif kind == "error":
            raise InputError(**content)
        elif kind == "unusable":
            raise MixpinnError(f"a worker process cannot take its task over: {content}")
        elif worker.job is not None:
            pose, _ = worker.job
            if kind == "finished":
                worker.job = None
            yield Event(pose, content if kind == "finished" else None)

    def give_up(self) -> Iterator[Event]:
        """End the workers that owe an answer and have been silent for too long."""
        limits = {
            worker: self.timeout if worker.started else self.start_timeout
            for worker in self.workers if not worker.ready or worker.job is not None
        }
        for worker in self.patience.lost(limits):
            worker.process.kill()  # one that is stopped does not hear anything else
            worker.process.join()
            reason = "it gave no sign of life"
            if worker.job:
                reason = f"no step within {limits[worker]:g} s, in each of {worker.job[1]} attempts"
            yield from self._bury(worker, reason)

    def _bury(self, worker: _Worker, reason: str) -> Iterator[Event]:
        """Decide what becomes of the pose in flight of a worker that ended."""
        self.workers.remove(worker)
        worker.connection.close()
        if not worker.ready:
            self.lost_starts += 1
            if self.lost_starts >= MAX_LOST_STARTS:
                fix = """; put what the script does under 'if __name__ == "__main__":'""" if self._needs_script else ""
                raise MixpinnError(
                    f"{self.lost_starts} worker processes in a row could not start; the last: {reason}{fix}"
                )
        if worker.job is None:
            return
        pose, attempt = worker.job
        status = self.store.status(pose)
        if status.state is PoseState.DONE:
            yield Event(pose, status)
        elif attempt < MAX_ATTEMPTS:
            self.queue.append((pose, attempt + 1))
        else:
            yield Event(pose, self.store.fail(pose, reason, attempts=attempt))

    def close(self) -> None:
        """End all workers."""
        try:
            end_all(worker.process for worker in self.workers)
        finally:
            for worker in self.workers:
                worker.connection.close()


def _send(connection: Connection, task: Any) -> None:
    with contextlib.suppress(OSError, ValueError):  # the worker is gone, or given up
        connection.send_bytes(task)
