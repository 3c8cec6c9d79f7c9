"""Generation: simulates every pose of a store that has no result yet, in parallel, resumable."""

import time
from collections.abc import Sequence
from typing import Any

from mixpinn.base.errors import InputError
from mixpinn.base.lock import locked
from mixpinn.base.progress import progress_bar
from mixpinn.dataset.dask_pool import run_dask
from mixpinn.dataset.local_pool import STEP_TIMEOUT, run_local
from mixpinn.dataset.protocol import Pose
from mixpinn.dataset.status import PoseState
from mixpinn.dataset.store import SimulationStore
from mixpinn.dataset.summary import SUMMARY, GenerationSummary, summarise
from mixpinn.dataset.worker import Runner
from mixpinn.records import TissueMesh
from mixpinn.records.answer import discretisation_of


def fem_runner() -> Runner:
    """The project's own solver, `mixpinn.fem.simulate_pose`."""
    from mixpinn import fem

    runner: Runner = fem.simulate_pose
    return runner


def generate(
    scene: Any, poses: Sequence[Pose], store: SimulationStore, *, workers: int = 1, threads: int = 1,
    runner: Runner | None = None, scheduler: str | None = None, retry_failed: bool = True,
    timeout: float = STEP_TIMEOUT,
) -> GenerationSummary:
    """Simulate those of `poses` that `store` does not hold yet.

    Each pose runs in a worker process and is stored by it, so that a killed run loses the poses in flight and
    nothing else; the same call continues where it stopped. A step that did not converge is recorded as such and
    never becomes a sample. A worker that dies, or finishes no step for too long, costs its pose one of two
    attempts. Control-C stops the workers, writes the summary so far and raises KeyboardInterrupt.

    Args:
        scene: handed to the runner as it is; must be picklable.
        poses: which to simulate, all or some of the store's.
        store: where results go.
        workers: processes on this machine; not used with a scheduler.
        threads: of each worker.
        runner: simulates one pose; by default the project's own solver.
        scheduler: address of a Dask scheduler whose workers are used instead.
        retry_failed: whether poses that failed before are tried again.
        timeout: a worker of this machine that finishes no step for so long is ended [s]; a runner that reports no steps
            has it for the whole pose.

    Returns:
        The totals of the whole store, which also lie in its ``summary.json``.

    Raises:
        InputError: fewer than one worker or thread, no time at all, poses that do not belong to the store, a scene of
            another mesh, a store that cannot be written, or one that another process simulates into.
    """
    _check(scene, poses, store, workers=workers, threads=threads, timeout=timeout)
    with locked(store.folder):
        return _generate(
            scene, poses, store, workers=workers, threads=threads, runner=runner or fem_runner(), scheduler=scheduler,
            retry_failed=retry_failed, timeout=timeout,
        )


def _generate(
    scene: Any, poses: Sequence[Pose], store: SimulationStore, *, workers: int, threads: int, runner: Runner,
    scheduler: str | None, retry_failed: bool, timeout: float,
) -> GenerationSummary:
    store.clear_unfinished()
    left_out = {PoseState.DONE} if retry_failed else {PoseState.DONE, PoseState.FAILED}
    open_poses = [pose for pose in poses if store.status(pose).state not in left_out]
    before = _wall_seconds(store)
    start = time.perf_counter()
    steps, done = store.protocol.steps, len(poses) - len(open_poses)
    events = (
        run_dask(store, scene, runner, open_poses, scheduler=scheduler) if scheduler
        else run_local(store, scene, runner, open_poses, workers=workers, threads=threads, timeout=timeout)
    )
    stepped = dict.fromkeys((pose.name for pose in open_poses), 0)
    ended = False
    try:
        with progress_bar() as bar:
            task = bar.add_task(_label(done, len(poses)), total=len(open_poses) * steps)
            for pose, status in events:
                if status is None:
                    stepped[pose.name] = min(stepped[pose.name] + 1, steps)
                else:
                    stepped[pose.name] = steps
                    done += 1
                bar.update(task, completed=sum(stepped.values()), description=_label(done, len(poses)))
        ended = True
    finally:
        events.close()
        if not scheduler:
            store.clear_unfinished()
        # An interrupted run ends at once; the next one looks for inverted cells.
        summary = summarise(store, wall_seconds=before + time.perf_counter() - start, workers=workers, cells=ended)
        summary.save(store.folder / SUMMARY)
    return summary


def _label(done: int, total: int) -> str:
    return f"simulate: pose {done} of {total}, steps"


def _wall_seconds(store: SimulationStore) -> float:
    """Wall time of earlier runs into this store [s]."""
    path = store.folder / SUMMARY
    try:
        return GenerationSummary.load(path).wall_seconds if path.exists() else 0.0
    except InputError:
        return 0.0


def _check(
    scene: Any, poses: Sequence[Pose], store: SimulationStore, *, workers: int, threads: int, timeout: float,
) -> None:
    if not timeout > 0.0:
        raise InputError("timeout", expected="more than 0 s", got=f"{timeout:g}", fix="correct the setting")
    for name, value in (("workers", workers), ("threads", threads)):
        if value < 1:
            raise InputError(name, expected="at least 1", got=str(value), fix="correct the setting")
    mesh = getattr(scene, "mesh", None)
    if isinstance(mesh, TissueMesh) and mesh.hash() != store.mesh_hash:
        raise InputError(
            str(store.folder), expected=f"a store of the scene's {discretisation_of(mesh)}",
            got=f"one of {store.discretisation}", fix="choose another folder",
        )
    known = set(store.poses)
    foreign = [pose.name for pose in poses if pose not in known]
    if foreign:
        raise InputError(
            str(store.folder), expected="poses of this store", got=", ".join(foreign[:3]),
            fix="choose among the store's poses",
        )
