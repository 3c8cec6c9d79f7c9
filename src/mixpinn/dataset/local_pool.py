"""Local pool: worker processes of this machine, of which each may die without harm to the others."""

import contextlib
import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from typing import Any, NamedTuple

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


class Event(NamedTuple):
    """News of a pose: a step computed (`status` None) or the pose finished."""

    pose: Pose
    status: PoseStatus | None


@dataclass
class _Worker:
    process: Any
    connection: Connection
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


def run_local(
    store: SimulationStore, scene: Any, runner: Runner, poses: Sequence[Pose], *, workers: int, threads: int,
) -> Generator[Event, None, None]:
    """Simulate `poses` in `workers` processes of `threads` threads each; yield news as it comes.

    Which worker computes a pose, and when, has no influence on its result: nothing is handed from pose to pose.
    A worker that dies costs the attempt at its pose in flight; a new worker takes its place. However the iteration
    ends, all workers are stopped.

    Raises:
        InputError: the store cannot be written.
        MixpinnError: a worker cannot even start.
    """
    context = multiprocessing.get_context("spawn")
    queue: deque[tuple[Pose, int]] = deque((pose, 1) for pose in poses)
    pool: list[_Worker] = []

    def start() -> None:
        here, there = context.Pipe()
        process = context.Process(target=serve, args=(there, store, scene, runner), daemon=True)
        with pinned_threads(threads), deaf_to_interrupts():
            process.start()
        there.close()  # so that the end of the worker shows as the end of the pipe
        pool.append(_Worker(process, here))

    try:
        while queue or any(worker.job for worker in pool):
            busy = sum(worker.job is not None for worker in pool)
            while len(pool) < min(workers, busy + len(queue)):
                start()
            for connection in wait([worker.connection for worker in pool]):
                worker = next(item for item in pool if item.connection is connection)
                yield from _listen(worker, pool, queue, store)
            for worker in pool:
                if queue and worker.ready and worker.job is None:
                    worker.job = queue.popleft()
                    # A worker that died between two poses shows as the end of its pipe in the next round.
                    with contextlib.suppress(OSError):
                        worker.connection.send(worker.job)
    finally:
        for worker in pool:
            worker.process.terminate()
        for worker in pool:
            worker.process.join()
            worker.connection.close()


def _listen(
    worker: _Worker, pool: list[_Worker], queue: deque[tuple[Pose, int]], store: SimulationStore,
) -> Iterator[Event]:
    try:
        kind, content = worker.connection.recv()
    except (EOFError, OSError):
        pool.remove(worker)
        worker.process.join()
        worker.connection.close()
        yield from _bury(worker, queue, store)
        return
    if kind == "ready":
        worker.ready = True
    elif kind == "error":
        raise InputError(**content)
    elif worker.job is not None:
        pose, _ = worker.job
        if kind == "finished":
            worker.job = None
            yield Event(pose, content)
        else:
            yield Event(pose, None)


def _bury(worker: _Worker, queue: deque[tuple[Pose, int]], store: SimulationStore) -> Iterator[Event]:
    """Decide what becomes of the pose in flight of a worker that died."""
    code = worker.process.exitcode
    if not worker.ready:
        raise MixpinnError(f"a worker process ended with code {code} before it could start; see its message above")
    if worker.job is None:
        return
    pose, attempt = worker.job
    status = store.status(pose)
    if status.state is PoseState.DONE:
        yield Event(pose, status)
    elif attempt < MAX_ATTEMPTS:
        queue.append((pose, attempt + 1))
    else:
        reason = f"its worker process died {attempt} times, the last time with code {code}"
        yield Event(pose, store.fail(pose, reason, attempts=attempt))
