"""Dask pool: the same poses on the workers of a Dask scheduler, on any number of machines."""

from collections.abc import Generator, Sequence
from dataclasses import replace
from typing import Any

from mixpinn.base.errors import InputError
from mixpinn.dataset.local_pool import MAX_ATTEMPTS, Event
from mixpinn.dataset.protocol import Pose
from mixpinn.dataset.status import PoseState
from mixpinn.dataset.store import SimulationStore
from mixpinn.dataset.worker import Runner, run_pose

_CONNECT = "20s"
"""How long a scheduler may take to answer."""


def connect_dask(scheduler: str) -> Any:
    """A client of the scheduler at the address `scheduler`, to be used in a ``with`` statement.

    Raises:
        InputError: Dask is not installed, the scheduler does not answer, or workers of several threads.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise InputError(
            "--scheduler", expected="the package dask[distributed]", got="it is not installed",
            fix="pip install 'mixpinn[distributed]'",
        ) from error
    try:
        client = Client(scheduler, timeout=_CONNECT, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise InputError(
            f"--scheduler {scheduler}", expected="the address of a running Dask scheduler",
            got=str(error) or repr(error),
            fix="start one with 'dask scheduler' and give the address that it prints",
        ) from error
    threaded = [name for name, count in client.nthreads().items() if count > 1]
    if threaded:
        client.close()
        raise InputError(
            f"--scheduler {scheduler}", expected="workers of one thread", got=f"{len(threaded)} workers of several",
            fix="start them with 'dask worker --nthreads 1'",
        )
    return client


def _hold(scene: Any) -> Any:
    """The scene as the result of a task: unlike scattered data, Dask makes it again when its holder dies."""
    return scene


def run_dask(
    store: SimulationStore, scene: Any, runner: Runner, poses: Sequence[Pose], *, scheduler: str,
) -> Generator[Event, None, None]:
    """Simulate `poses` on the workers of the scheduler at `scheduler`; yield each when it is finished.

    The store's folder must be visible to all workers under the same path. Workers need one thread each
    (``dask worker --nthreads 1 --nworkers N``), since a process computes one pose at a time; Dask's nanny pins
    OMP_NUM_THREADS and MKL_NUM_THREADS to 1 by itself. A worker that dies costs its pose in flight, which Dask
    hands to another one; finished poses are in the store already.

    Raises:
        InputError: Dask is not installed, the scheduler does not answer, or workers of several threads.
    """
    # Workers have working directories of their own.
    store = replace(store, folder=store.folder.resolve())
    with connect_dask(scheduler) as client:
        from distributed import KilledWorker, as_completed

        held = client.submit(_hold, scene, pure=False)
        by_key = {pose.name: pose for pose in poses}

        def submit(pose: Pose, attempt: int) -> Any:
            key = f"{store.folder}:{attempt}:{pose.name}"
            return client.submit(run_pose, store, held, runner, pose, key=key, pure=False, retries=1)

        futures = as_completed([submit(pose, 1) for pose in poses], loop=client.loop)
        for future in futures:
            _, attempt, name = str(future.key).rsplit(":", 2)
            pose = by_key[name]
            try:
                status = future.result()
            except InputError:
                raise
            except Exception as cause:
                # The result can be lost with its worker after the pose was stored, and so can a task's place.
                status = store.status(pose)
                if status.state is not PoseState.DONE:
                    if not isinstance(cause, KilledWorker) and int(attempt) < MAX_ATTEMPTS:
                        futures.add(submit(pose, int(attempt) + 1))
                        continue
                    status = store.fail(pose, f"{type(cause).__name__}: {cause}", attempts=MAX_ATTEMPTS)
            yield Event(pose, status)
            future.release()
