"""Generation: simulates every pose of a store that has no result yet, in parallel, resumable."""

import time
from collections.abc import Callable, Sequence
from typing import Any

from mixpinn.base.errors import InputError
from mixpinn.base.lock import locked
from mixpinn.base.progress import progress_bar
from mixpinn.dataset.dask_pool import run_dask
from mixpinn.dataset.local_pool import STEP_TIMEOUT, run_local
from mixpinn.dataset.protocol import Pose
from mixpinn.dataset.status import PoseState, PoseStatus
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
    check_request(scene, poses, store, workers=workers, threads=threads, timeout=timeout)
    with PoseBar(poses, store, retry_failed=retry_failed) as bar:
        return run_poses(
            scene, poses, store, bar.hear, workers=workers, threads=threads, runner=runner, scheduler=scheduler,
            retry_failed=retry_failed, timeout=timeout,
        )


def run_poses(
    scene: Any, poses: Sequence[Pose], store: SimulationStore, hear: Callable[[Pose, PoseStatus | None], None], *,
    workers: int, threads: int, runner: Runner | None = None, scheduler: str | None = None, retry_failed: bool = True,
    timeout: float = STEP_TIMEOUT, stopped: Callable[[], bool] = lambda: False,
) -> GenerationSummary:
    """`generate` without a bar of its own, for what `check_request` has let pass.

    Args:
        scene, poses, store, workers, threads, runner, scheduler, retry_failed, timeout: as for `generate`.
        hear: called with each pose that finishes a step (without status) or ends.
        stopped: asked about once a second; once it says so, the workers of this machine are ended.
    """
    runner = runner or fem_runner()
    with locked(store.folder):
        store.clear_unfinished()
        open_poses = [pose for pose in poses if _is_open(store.status(pose), retry_failed)]
        before, start, ended = _wall_seconds(store), time.perf_counter(), False
        events = (
            run_dask(store, scene, runner, open_poses, scheduler=scheduler) if scheduler
            else run_local(
                store, scene, runner, open_poses, workers=workers, threads=threads, timeout=timeout, stopped=stopped,
            )
        )
        try:
            for pose, status in events:
                hear(pose, status)
            ended = not stopped()
        finally:
            events.close()
            if not scheduler:
                store.clear_unfinished()
            # An interrupted run ends at once; the next one looks for inverted cells.
            seconds = before + time.perf_counter() - start
            summary = summarise(store, wall_seconds=seconds, workers=workers, cells=ended)
            summary.save(store.folder / SUMMARY)
        return summary


def _is_open(status: PoseStatus, retry_failed: bool) -> bool:
    return status.state not in ({PoseState.DONE} if retry_failed else {PoseState.DONE, PoseState.FAILED})


class PoseBar:
    """A progress bar of poses; its length is the steps of those that a store does not hold when it begins."""

    def __init__(self, poses: Sequence[Pose], store: SimulationStore, *, retry_failed: bool = True) -> None:
        """Of these poses."""
        left = [pose for pose in poses if _is_open(store.status(pose), retry_failed)]
        self._steps, self._poses, self._done = store.protocol.steps, len(poses), len(poses) - len(left)
        self._stepped = dict.fromkeys((pose.name for pose in left), 0)
        self._bar = progress_bar()

    def __enter__(self) -> "PoseBar":
        self._bar.__enter__()
        self._task = self._bar.add_task(self._label(), total=len(self._stepped) * self._steps)
        return self

    def __exit__(self, *about: Any) -> None:
        self._bar.__exit__(*about)

    def hear(self, pose: Pose, status: PoseStatus | None) -> None:
        """A pose that finished a step (without status) or ended."""
        if pose.name not in self._stepped:
            return
        if status is None:
            self._stepped[pose.name] = min(self._stepped[pose.name] + 1, self._steps)
        else:
            self._stepped[pose.name] = self._steps
            self._done += 1
        self._bar.update(self._task, completed=sum(self._stepped.values()), description=self._label())

    def _label(self) -> str:
        return f"simulate: pose {self._done} of {self._poses}, steps"


def _wall_seconds(store: SimulationStore) -> float:
    """Wall time of earlier runs into this store [s]."""
    path = store.folder / SUMMARY
    try:
        return GenerationSummary.load(path).wall_seconds if path.exists() else 0.0
    except InputError:
        return 0.0


def check_request(
    scene: Any, poses: Sequence[Pose], store: SimulationStore, *, workers: int, threads: int, timeout: float,
) -> None:
    """Refuse what `generate` cannot do; its arguments and errors."""
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
