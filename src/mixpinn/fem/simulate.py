"""Press the probe along a path and record every step."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from mixpinn.base.arrays import FloatArray, IntArray
from mixpinn.base.errors import InputError
from mixpinn.fem.contact import ContactModel, ProbePose
from mixpinn.fem.scene import Scene
from mixpinn.fem.solve import Balance, QuasiStaticSolver
from mixpinn.fem.system import ElasticSystem, State
from mixpinn.records import ProbePath, Simulation

NO_FORCE = 1e-6
"""A node with less force than this [N] is not loaded."""


@dataclass(frozen=True, eq=False)
class _Equilibrium:
    """The last converged step: configuration, probe pose, elastic slips, and the increment that led there."""

    balance: Balance
    pose: ProbePose
    slip: FloatArray | None
    increment: FloatArray | None


class PoseSimulator:
    """Simulates pose after pose of one scene; what depends on the scene alone is made once."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.contact: ContactModel = scene.contact_model()
        self.system: ElasticSystem = scene.elastic_system(self.contact)
        self.solver = QuasiStaticSolver(self.system, self.contact, scene.solver)

    def run(
        self, path: ProbePath, *, position_index: int = 0, rotation_deg: float = 0.0,
        on_step: Callable[[int], None] | None = None,
    ) -> Simulation:
        """Simulate one pose.

        A step that does not converge is halved up to `SolverConfig.max_cuts` times; if it still fails, it and the
        steps after it are recorded as not converged.

        Args:
            path: poses of the probe, step by step.
            position_index: recorded with the result.
            rotation_deg: recorded with the result.
            on_step: called with the number of each finished step.

        Raises:
            InputError: the probe starts inside the body.
        """
        poses = [ProbePose(r, t) for r, t in zip(path.rotations, path.translations, strict=True)]
        self._refuse_start_inside(poses[0])
        recorder = _Recorder(self.contact, self.system, len(poses))
        rest = self.system.rest_state()
        frame = self.contact.begin_step(self._skin(rest), poses[0], None)
        last = _Equilibrium(self.solver.balance(rest, poses[0], frame), poses[0], None, None)
        for step, pose in enumerate(poses):
            began, effort = time.perf_counter(), self.solver.effort.iterations
            found, residual = self._advance(last, pose, self.scene.solver.max_cuts)
            if found is None:
                recorder.fail(step, residual, time.perf_counter() - began)
                break
            last = found
            recorder.write(
                step, last.balance, pose, residual=residual, iterations=self.solver.effort.iterations - effort,
                seconds=time.perf_counter() - began,
            )
            if on_step is not None:
                on_step(step)
        return recorder.finish(self.scene.mesh.hash(), position_index, rotation_deg, path)

    def _skin(self, state: State) -> FloatArray:
        return self.contact.skin.vertices(state.points)

    def _refuse_start_inside(self, pose: ProbePose) -> None:
        vertices = self._skin(self.system.rest_state())
        near, _, samples, _ = self.contact.near(vertices, pose, self.scene.contact.alarm)
        inside = _below_skin(samples, vertices, self.contact.skin.surface.triangles)
        touching = len(near) and near.distance.min() < 0.5 * self.scene.contact.gap
        if inside or touching:
            raise InputError(
                "probe", expected="a path that begins outside the body",
                got=f"{inside} probe points under the skin at the first step" if inside else "a start closer than half the gap",
                fix="start higher above the skin (a longer approach) or check the frame of the positions",
            )

    def _advance(self, last: _Equilibrium, pose: ProbePose, cuts: int) -> tuple[_Equilibrium | None, float]:
        """Go from equilibrium `last` to `pose`, in halves where needed."""
        frame = self.contact.begin_step(self._skin(last.balance.state), last.pose, last.slip)
        guess = last.balance.state
        if last.increment is not None:
            guess = self.system.advance(guess, last.increment)
        solution = self.solver.solve(guess, pose, frame)
        if not solution.converged and last.increment is not None:
            solution = self.solver.solve(last.balance.state, pose, frame)
        residual = solution.history[-1]
        if solution.converged:
            slip = None if solution.balance.contact is None else solution.balance.contact.slip
            loaded = solution.balance.contact is not None and solution.balance.contact.hits > 0
            increment = increment_between(self.system, last.balance.state, solution.balance.state) if loaded else None
            return _Equilibrium(solution.balance, pose, slip, increment), residual
        if cuts == 0:
            return None, residual
        still = _Equilibrium(last.balance, last.pose, last.slip, None)
        half, residual = self._advance(still, last.pose.towards(pose, 0.5), cuts - 1)
        return (None, residual) if half is None else self._advance(half, pose, cuts - 1)


def increment_between(system: ElasticSystem, start: State, end: State) -> FloatArray:
    """The reduced increment that takes `start` to `end`, shape (n_dofs,); inverse of `ElasticSystem.advance`."""
    free = (system.mesh.part == 0) & ~system.mesh.fixed
    soft = (end.points - start.points)[free].ravel()
    turn = Rotation.from_matrix(end.rotation @ start.rotation.transpose(0, 2, 1)).as_rotvec() if len(end.rotation) else (
        np.empty((0, 3))
    )
    twists = np.concatenate([end.translation - start.translation, turn.reshape(-1, 3)], axis=1)
    return np.concatenate([soft, twists.ravel()])


def simulate_pose(
    scene: Scene, path: ProbePath, *, position_index: int, rotation_deg: float,
    on_step: Callable[[int], None] | None = None,
) -> Simulation:
    """Simulate one pose of `scene`; the preparation for the last scene is kept for the next call."""
    global _simulator
    if _simulator is None or _simulator.scene is not scene:
        _simulator = PoseSimulator(scene)
    return _simulator.run(path, position_index=position_index, rotation_deg=rotation_deg, on_step=on_step)


_simulator: PoseSimulator | None = None


def _below_skin(samples: FloatArray, vertices: FloatArray, triangles: IntArray) -> int:
    """Number of samples inside the closed surface, by the generalized winding number (solid angles / 4π)."""
    corners = vertices[triangles]
    inside = 0
    for point in samples:
        a, b, c = np.moveaxis(corners - point, 1, 0)
        la, lb, lc = (np.linalg.norm(edge, axis=1) for edge in (a, b, c))
        numerator = np.einsum("ij,ij->i", a, np.cross(b, c))
        denominator = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
        inside += 2.0 * np.arctan2(numerator, denominator).sum() > 2.0 * np.pi
    return int(inside)


class _Recorder:
    """Collects the arrays of a `Simulation`."""

    def __init__(self, contact: ContactModel, system: ElasticSystem, n_steps: int) -> None:
        self.contact, self.system = contact, system
        n, k = system.mesh.n_points, system.mesh.n_parts
        self.displacement = np.zeros((n_steps, n, 3), dtype=np.float32)
        self.wrench = np.zeros((n_steps, 6))
        self.rotation = np.tile(np.eye(3), (n_steps, k, 1, 1))
        self.translation = np.zeros((n_steps, k, 3))
        self.scalars = {
            name: np.full(n_steps, fill) for name, fill in (
                ("residual", np.nan), ("energy", np.nan), ("min_jacobian", np.nan), ("penetration", np.nan),
                ("seconds", 0.0),
            )
        }
        self.converged = np.zeros(n_steps, dtype=bool)
        self.iterations = np.zeros(n_steps, dtype=np.int64)
        self.nodes: list[IntArray] = []
        self.forces: list[FloatArray] = []

    def write(
        self, step: int, at: Balance, pose: ProbePose, *, residual: float, iterations: int, seconds: float,
    ) -> None:
        points = at.state.points
        self.displacement[step] = points - self.system.mesh.points
        self.wrench[step, :3] = at.external.sum(axis=0)
        self.wrench[step, 3:] = np.cross(points - pose.translation, at.external).sum(axis=0)
        self.rotation[step], self.translation[step] = at.state.rotation, at.state.translation
        self.scalars["residual"][step] = residual
        self.scalars["energy"][step] = self.system.energy(at.state)
        self.scalars["min_jacobian"][step] = self.system.min_jacobian(at.state)
        self.scalars["penetration"][step] = at.contact.penetration if at.contact else 0.0
        self.scalars["seconds"][step] = seconds
        self.converged[step], self.iterations[step] = True, iterations
        skin = self.contact.skin
        first, second, _, _ = self.contact.near(skin.vertices(points), pose, self.contact.config.alarm)
        used = skin.surface.triangles[first.triangle][first.weights > 0.0]
        vertices = np.unique(np.concatenate([used, second.point]))
        near = np.unique(skin.nodes[vertices][skin.weights[vertices] != 0.0])
        loaded = np.flatnonzero(np.abs(at.external).max(axis=1) > NO_FORCE)
        nodes = np.union1d(near, loaded).astype(np.int64)
        forces = -at.external[nodes]
        forces[np.abs(forces).max(axis=1, initial=0.0) <= NO_FORCE] = 0.0
        self.nodes.append(nodes)
        self.forces.append(forces)

    def fail(self, step: int, residual: float, seconds: float) -> None:
        self.scalars["residual"][step], self.scalars["seconds"][step] = residual, seconds

    def finish(self, mesh_hash: str, position_index: int, rotation_deg: float, path: ProbePath) -> Simulation:
        counts = np.zeros(len(path), dtype=np.int64)
        counts[: len(self.nodes)] = [len(nodes) for nodes in self.nodes]
        return Simulation(
            mesh_hash=mesh_hash, position_index=position_index, rotation_deg=rotation_deg, path=path,
            displacement=self.displacement, contact_offsets=np.concatenate([[0], np.cumsum(counts)]),
            contact_nodes=np.concatenate([*self.nodes, np.empty(0, dtype=np.int64)]),
            contact_forces=np.concatenate([*self.forces, np.empty((0, 3))]), probe_wrench=self.wrench,
            part_rotation=self.rotation, part_translation=self.translation, converged=self.converged,
            iterations=self.iterations, **self.scalars,
        )
