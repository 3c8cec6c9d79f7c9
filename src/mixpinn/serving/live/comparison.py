"""FullSolution: the solver beside a live session, in a process of its own, to hold an answer against.

The solver knows one rigid probe. Several that press in the same direction are one: their surfaces, placed as they end,
move along that direction together. A probe that is to touch later than another then waits above the skin, as it does in
the model.
"""

import contextlib
import multiprocessing
import os
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from mixpinn.base.arrays import FloatArray
from mixpinn.base.errors import InputError, MixpinnError, SolveError
from mixpinn.geometry.probe_pose import ProbePose
from mixpinn.physics.restraints import FREE, Restraints
from mixpinn.records import TissueMesh
from mixpinn.records.answer import Answer
from mixpinn.serving.hybrid_predictor import HybridPredictor

_NICE = 10
_SAME_DIRECTION = 0.5
"""Probes whose axes differ by less press in the same direction [degree]."""


@dataclass(frozen=True, eq=False)
class Setup:
    """What the solver needs to know of a bundle, and the poses of k probes.

    Attributes:
        mesh: of the bundle.
        mu, lam: Lamé constants of each tissue [MPa].
        points, triangles: the surface of one probe [mm].
        gap, friction: of contact [mm].
        poses: of the probes.
        restraints: joints and foundations.
        refinement: of the cells under the probe, as the bundle has it; None: none.
    """

    mesh: TissueMesh
    mu: tuple[float, ...]
    lam: tuple[float, ...]
    points: FloatArray
    triangles: Any
    gap: float
    friction: float
    poses: tuple[ProbePose, ...]
    restraints: Restraints = FREE
    refinement: dict[str, Any] | None = None

    @staticmethod
    def of_predictor(predictor: HybridPredictor, poses: Sequence[ProbePose]) -> "Setup":
        """The bundle's scene with its first probe at each of the poses.

        Raises:
            InputError: no pose, or probes that press in different directions.
        """
        if not poses:
            raise InputError("compare", expected="a probe", got="none", fix="press first")
        cosine = min(float(pose.axis @ poses[0].axis) for pose in poses)
        if cosine < np.cos(np.deg2rad(_SAME_DIRECTION)):
            angle = np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0)))
            raise InputError(
                "compare", expected="probes that press in the same direction", got=f"{angle:.0f}° between them",
                fix="straighten them, or press with one probe",
            )
        model, equilibrium = predictor.pressing, predictor.model.newton.equilibrium
        probe, config = model.probes[0].probe, model.contact.config
        return Setup(
            predictor.mesh, tuple(map(float, equilibrium.mu)), tuple(map(float, equilibrium.lam)), probe.points,
            probe.triangles, config.gap, config.friction, tuple(poses), predictor.model.prior.restraints,
            predictor.model.refinement,
        )

    @property
    def places(self) -> list[FloatArray]:
        """The vertices of each probe where it ends, world [mm]."""
        return [self.points @ pose.rotation.T + pose.translation for pose in self.poses]


class FullSolution:
    """One full solve in a child process: straight down the probe's axis to the pose.

    The child yields to the live session: it runs at low priority.
    """

    def __init__(
        self, setup: Setup, *, progress: Callable[[int, int], None], finished: Callable[[Answer | MixpinnError], None],
    ) -> None:
        """Begin; both are called from a thread of its own.

        Args:
            setup: what is pressed with what, and where to.
            progress: steps done, and of how many.
            finished: the answer, or what went wrong; not called where it was cancelled.
        """
        self._progress, self._finished = progress, finished
        context = multiprocessing.get_context("spawn")
        self._here, there = context.Pipe(duplex=False)
        self._process = context.Process(target=_solve, args=(setup, there), name="mixpinn-full-solution", daemon=True)
        self._lock, self._over = threading.Lock(), False
        self._process.start()
        there.close()
        self._thread = threading.Thread(target=self._follow, name="mixpinn-comparison", daemon=True)
        self._thread.start()

    def cancel(self) -> bool:
        """End it; nothing more is told. Whether it was still running."""
        with self._lock:
            if self._over:
                return False
            self._over = True
        self._process.terminate()
        return True

    def wait(self, timeout: float | None = None) -> bool:
        """Wait for its end; whether it has ended."""
        self._thread.join(timeout)
        return not self._thread.is_alive()

    def _follow(self) -> None:
        found: Answer | MixpinnError = SolveError("the full solution: its process ended early, perhaps out of memory")
        with contextlib.suppress(EOFError, OSError):
            while True:
                kind, value = self._here.recv()
                if kind != "step":
                    found = value
                    break
                if not self._over:
                    self._progress(*value)
        self._here.close()
        self._process.join(10.0)
        with self._lock:
            told, self._over = not self._over, True
        if told:
            self._finished(found)


def solve_fully(setup: Setup, on_step: Callable[[int, int], None] | None = None) -> Answer:
    """The full solution in this process; force and moment are (3,) of one probe and (k, 3) of more. Imports the solver.

    Args:
        setup: what is pressed with what, and where to.
        on_step: called with how many steps are done, and of how many.
    """
    from mixpinn.fem import ContactConfig, Scene, StableNeoHookean
    from mixpinn.fem.scene_record import refinement_of
    from mixpinn.fem.solve.pose import solve_pose
    from mixpinn.records import Probe

    first = setup.poses[0]
    points = np.concatenate([(place - first.translation) @ first.rotation for place in setup.places])
    shift = len(setup.points) * np.arange(len(setup.poses))
    triangles = np.concatenate([np.asarray(setup.triangles) + start for start in shift])
    scene = Scene(
        setup.mesh, Probe(points, triangles),
        tuple(StableNeoHookean(mu=mu, lam=lam) for mu, lam in zip(setup.mu, setup.lam, strict=True)),
        ContactConfig(gap=setup.gap, friction=setup.friction), joints=setup.restraints.joints,
        foundations=setup.restraints.foundations, membrane=setup.restraints.membrane,
        refinement=None if setup.refinement is None else refinement_of(setup.refinement),
    )
    found = solve_pose(scene, first.translation, first.rotation, on_step=on_step)
    return found if len(setup.poses) == 1 else _shared(found, setup)


def _shared(found: Answer, setup: Setup) -> Answer:
    """With force and moment of each probe, (k, 3): a node is pressed by the probe that is nearest to it."""
    assert found.contact is not None
    assert found.contact.forces is not None
    nodes, force = found.contact.nodes, -np.asarray(found.contact.forces, dtype=np.float64)
    where = found.mesh.node_points[nodes] + found.displacement[nodes]
    distance = np.array([
        np.linalg.norm(where[:, None] - place, axis=2).min(axis=1, initial=np.inf) for place in setup.places
    ])
    own = distance.argmin(axis=0)[:, None] == np.arange(len(setup.poses))
    moments = [np.cross(where - pose.translation, force) for pose in setup.poses]
    return replace(
        found, force=own.T.astype(np.float64) @ force,
        moment=np.array([moment[mine].sum(axis=0) for moment, mine in zip(moments, own.T, strict=True)]),
    )


def _solve(setup: Setup, connection: "Connection[Any, Any]") -> None:
    """What the child does."""
    with contextlib.suppress(OSError):
        os.nice(_NICE)
    try:
        answer = solve_fully(setup, lambda done, of: connection.send(("step", (done, of))))
        connection.send(("done", replace(answer, history=None)))
    except InputError as error:
        connection.send(("done", SolveError(str(error))))
    except (BrokenPipeError, KeyboardInterrupt):
        pass
    except Exception as error:
        connection.send(("done", SolveError(f"the full solution: {type(error).__name__}: {error}")))
    connection.close()
