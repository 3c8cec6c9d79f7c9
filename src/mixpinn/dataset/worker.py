"""Worker: simulates one pose at a time in a process of its own and stores each result itself."""

import signal
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any, Protocol

from mixpinn.base.child_process import end_with_parent
from mixpinn.base.errors import InputError
from mixpinn.dataset.protocol import Pose, probe_path
from mixpinn.dataset.status import PoseState, PoseStatus
from mixpinn.dataset.store import SimulationStore
from mixpinn.records import ProbePath, Simulation


class Runner(Protocol):
    """Simulates one pose of a scene; `mixpinn.fem.simulate_pose` is the one to use. Must be importable by name.

    ``runner(scene, path, position_index=…, rotation_deg=…, on_step=…)`` calls ``on_step(step)`` after each step.
    """

    def __call__(
        self, scene: Any, path: ProbePath, /, *, position_index: int, rotation_deg: float,
        on_step: Callable[[int], None] | None = None,
    ) -> Simulation: ...


class _ParentGone(BaseException):
    """The process that hands out the poses has ended; no `except Exception` on the way may hold this up."""


def run_pose(
    store: SimulationStore, scene: Any, runner: Runner, pose: Pose, *, attempt: int = 1,
    on_step: Callable[[int], None] | None = None,
) -> PoseStatus:
    """Simulate one pose and store it; a pose that is done already is left alone.

    Any error of the runner makes this pose a failed one, with the error as its reason.

    Raises:
        InputError: the store cannot be written.
    """
    before = store.status(pose)
    if before.state is PoseState.DONE:
        return before
    path = probe_path(pose.position, pose.rotation_deg, store.protocol)
    try:
        simulation = runner(
            scene, path, position_index=pose.position_index, rotation_deg=pose.rotation_deg, on_step=on_step,
        )
    except Exception as error:  # one pose must not end the others
        return store.fail(pose, f"{type(error).__name__}: {error}", attempts=attempt)
    return store.save(pose, simulation, attempts=attempt)


def serve(connection: Connection, parent: int) -> None:
    """Loop of a worker process: receives what it works on, then ``(pose, attempt)`` until None or the parent is gone.

    Sends ``("started", None)``, whereupon it is sent ``(store, scene, runner)``, and ``("ready", None)``; then for each
    pose ``("step", index)`` while it runs and ``("finished", status)``. ``("error", fields)`` where the store cannot be
    written, ``("unusable", text)`` where what it is to work on cannot be taken over.

    Args:
        connection: to the parent.
        parent: the number of its process.
    """
    end_with_parent(parent)
    # Control-C reaches the whole process group; the parent alone decides what it means.
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def report(step: int) -> None:
        try:
            connection.send(("step", int(step)))
        except OSError as error:
            raise _ParentGone from error

    try:
        connection.send(("started", None))
        try:
            store, scene, runner = connection.recv()
        except (EOFError, OSError):
            raise
        except Exception as error:  # whatever its modules raise when they are imported here
            connection.send(("unusable", f"{type(error).__name__}: {error}"))
            return
        connection.send(("ready", None))
        while (message := connection.recv()) is not None:
            pose, attempt = message
            status = run_pose(store, scene, runner, pose, attempt=attempt, on_step=report)
            connection.send(("finished", status))
    except InputError as error:
        connection.send(("error", {"what": error.what, "expected": error.expected, "got": error.got, "fix": error.fix}))
    except (EOFError, OSError, _ParentGone):
        return
