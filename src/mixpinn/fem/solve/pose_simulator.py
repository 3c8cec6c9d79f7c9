"""Press the probe along a path and record every step."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mixpinn.base.arrays import FloatArray, IntArray
from mixpinn.base.errors import InputError
from mixpinn.fem.contact.model import ContactModel
from mixpinn.fem.contact.surfaces import SkinPatch, SkinSurface
from mixpinn.fem.elements.system import ElasticSystem, State
from mixpinn.fem.scene import Scene
from mixpinn.fem.solve.linear import LinearSolver
from mixpinn.fem.solve.quasi_static import Balance, QuasiStaticSolver
from mixpinn.fem.solve.scene_models import contact_model, elastic_system
from mixpinn.geometry.probe_pose import ProbePose
from mixpinn.records import ProbePath, Simulation

NO_FORCE = 1e-6
"""A node with less force than this [N] is not loaded."""


_LARGEST_MOVE = 0.75
"""A probe point may move by this part of the gap between two solves: the skin must not end up on its other side."""

_SOFT_STICK = 1.0 / 16.0
"""Coulomb's law with friction coefficients of about one need not have a solution close to the last: a point that sticks
would slide, and one that slides would stick. Points that give way more before they slide then let the step end."""

_FACTORIZATIONS = 60
"""A step that has taken so many is not divided further."""

_MARGIN = 6.0
"""Skin that comes within this distance [mm] of the probe's path belongs to the patch on which contact is sought."""


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """The last converged step: where a path continues from.

    Attributes:
        balance: configuration and forces.
        pose: of the probe.
        slip: elastic slip of each contact point [mm], shape (p, 3); None before contact.
        increment: of the unknowns that led there, a guess for the next step.
    """

    balance: Balance
    pose: ProbePose
    slip: FloatArray | None
    increment: FloatArray | None


class PoseSimulator:
    """Simulates pose after pose of one scene; what depends on the scene alone is made once."""

    def __init__(self, scene: Scene, *, linear: LinearSolver | None = None) -> None:
        """Prepare.

        Args:
            scene: what to simulate.
            linear: sparse direct solver; by default the best that the platform has.

        Raises:
            InputError: a scene with a refinement: each of its poses has a mesh of its own
                (`mixpinn.fem.solve.refined_pose`).
        """
        if scene.refinement is not None:
            raise InputError(
                "scene", expected="one mesh for all poses", got="cells that are refined for each pose",
                fix="use simulate_pose or RefinedSimulator, or leave the refinement out",
            )
        self.scene = scene
        self.contact: ContactModel = contact_model(scene)
        self.system: ElasticSystem = elastic_system(scene)
        self.solver = QuasiStaticSolver(self.system, self.contact, scene.solver, linear=linear)
        self._most = _FACTORIZATIONS

    def run(
        self, path: ProbePath, *, position_index: int = 0, rotation_deg: float = 0.0,
        on_step: Callable[[int], None] | None = None,
    ) -> Simulation:
        """Simulate one pose.

        A step over which a point of the probe moves far is divided beforehand; one that does not converge is halved
        up to `SolverConfig.max_cuts` times, fewer where that has taken long; if it still fails, it and the steps after
        it are recorded as not converged. The result does not depend on poses simulated before.

        Args:
            path: poses of the probe, step by step.
            position_index: recorded with the result.
            rotation_deg: recorded with the result.
            on_step: called with the number of each finished step.

        Raises:
            InputError: the probe starts inside the body.
        """
        return self.follow(path, position_index=position_index, rotation_deg=rotation_deg, on_step=on_step)[0]

    def follow(
        self, path: ProbePath, *, start: Equilibrium | None = None, position_index: int = 0,
        rotation_deg: float = 0.0, on_step: Callable[[int], None] | None = None,
    ) -> tuple[Simulation, Equilibrium]:
        """Simulate one path, from rest or from where an earlier one ended.

        Args:
            path: poses of the probe, step by step.
            start: where the path continues from; None for rest, with the probe outside the body.
            position_index, rotation_deg, on_step: as in `run`.

        Returns:
            All steps, and the last that converged.

        Raises:
            InputError: the probe starts inside the body.
        """
        poses = [ProbePose(r, t) for r, t in zip(path.rotations, path.translations, strict=True)]
        rest = self.system.rest_state()
        recorder = _Recorder(self.contact, self.system, len(poses))
        if start is None:
            entry = self._entry(poses[0], rest)
            self.solver.begin(self.contact.reachable(self._skin(rest), [entry, *poses], margin=_MARGIN))
            last = Equilibrium(self.solver.balance(rest, None), entry, None, None)
        else:
            skin = self._skin(start.balance.state)
            self.solver.begin(self.contact.reachable(skin, [start.pose, *poses], margin=_MARGIN))
            last = start
        for step, pose in enumerate(poses):
            began, effort = time.perf_counter(), self.solver.effort.iterations
            self._most = self.solver.effort.factorizations + _FACTORIZATIONS
            found, residual = self._follow(last, pose)
            if found is None:
                recorder.fail(step, residual, time.perf_counter() - began)
                break
            last, near = found
            recorder.write(
                step, last.balance, pose, near, residual=residual, iterations=self.solver.effort.iterations - effort,
                seconds=time.perf_counter() - began,
            )
            if on_step is not None:
                on_step(step)
        return recorder.finish(self.scene.mesh.hash(), position_index, rotation_deg, path), last

    def _skin(self, state: State) -> FloatArray:
        return self.contact.skin.vertices(state.points)

    def _entry(self, first: ProbePose, rest: State) -> ProbePose:
        """Where the probe stands before the first step: that step's pose, drawn back until contact does not act yet.

        A path may begin at first touch, so that its first step already indents.
        """
        vertices, gap = self._skin(rest), self.scene.contact.gap
        inside, distance = self.contact.clearance(vertices, first)
        if inside:
            raise InputError(
                "probe", expected="a path that begins outside the body",
                got=f"{inside} probe points under the skin at the first step",
                fix="start higher above the skin (a longer approach) or check the frame of the positions",
            )
        backwards, pose = -first.axis, first
        for _ in range(20):
            if distance >= gap:
                break
            pose = ProbePose(pose.rotation, pose.translation + 0.25 * gap * backwards)
            _, distance = self.contact.clearance(vertices, pose)
        return pose

    def _follow(self, last: Equilibrium, pose: ProbePose) -> tuple[tuple[Equilibrium, IntArray] | None, float]:
        """Go to `pose` and see to it that no skin beside the patch was touched; also the skin vertices near it."""
        while True:
            found, residual = self._divide(last, pose)
            if found is None:
                return None, residual
            vertices = self._skin(found.balance.state)
            near = self.contact.near_vertices(vertices, pose, self.contact.config.alarm)
            patch = self.solver.patch
            beside = near if patch is None else np.setdiff1d(near, patch.vertices)
            if not len(beside):
                return (found, near), residual
            # Skin slid under the probe from beside the patch: widen it, and repeat the step if any was touched.
            known = beside[:0] if patch is None else patch.vertices
            wider = self.contact.reachable(vertices, [pose], margin=_MARGIN).vertices
            # `beside` as well: contact points on the probe may lie farther apart than the margin.
            wider = np.union1d(wider, beside)
            self.solver.begin(SkinPatch.of_vertices(self.contact.skin, np.union1d(known, wider)))
            touched = self.contact.near_vertices(vertices, pose, self.contact.config.gap)
            if not len(np.setdiff1d(touched, known)):
                return (found, near), residual

    def _divide(self, last: Equilibrium, pose: ProbePose) -> tuple[Equilibrium | None, float]:
        """Go from equilibrium `last` to `pose` in as many parts as the probe's motion asks for."""
        corners = self.contact.probe.vertices
        move = np.linalg.norm(pose.place(corners) - last.pose.place(corners), axis=1).max()
        parts = max(1, int(np.ceil(move / (_LARGEST_MOVE * self.scene.contact.gap) - 1e-9)))
        start, residual = last.pose, np.nan
        for part in range(parts):
            target = pose if part == parts - 1 else start.towards(pose, (part + 1) / parts)
            found, residual = self._advance(last, target, self.scene.solver.max_cuts)
            if found is None:
                return None, residual
            last = found
        return last, residual

    def _advance(self, last: Equilibrium, pose: ProbePose, cuts: int) -> tuple[Equilibrium | None, float]:
        """Go from equilibrium `last` to `pose`, in halves where needed."""
        before = last.pose if self.scene.contact.dragging else pose
        frame = self.contact.begin_step(self._skin(last.balance.state), before, last.slip)
        guess = last.balance.state
        if last.increment is not None:
            guess = self.system.advance(guess, last.increment)
        solution = self.solver.solve(guess, pose, frame)
        if not solution.converged and last.increment is not None:
            solution = self.solver.solve(last.balance.state, pose, frame)
        if not solution.converged and self.scene.contact.friction:
            solution = self.solver.solve(last.balance.state, pose, frame, stick=_SOFT_STICK)
        residual = solution.history[-1]
        if solution.converged:
            forces, slip, increment = solution.balance.contact, None, None
            if forces is not None and solution.problem is not None and forces.hits:
                slip = solution.problem.slip_everywhere(forces)
                increment = self.system.difference(last.balance.state, solution.balance.state)
            return Equilibrium(solution.balance, pose, slip, increment), residual
        if cuts == 0 or self.solver.effort.factorizations > self._most:
            return None, residual
        still = Equilibrium(last.balance, last.pose, last.slip, None)
        half, residual = self._advance(still, last.pose.towards(pose, 0.5), cuts - 1)
        return (None, residual) if half is None else self._advance(half, pose, cuts - 1)


def simulator_of(scene: Scene) -> PoseSimulator:
    """The simulator of `scene`; that of the last scene is kept."""
    global _simulator
    if _simulator is None or _simulator.scene is not scene:
        _simulator = PoseSimulator(scene)
    return _simulator


_simulator: PoseSimulator | None = None


def loaded_nodes(at: Balance, skin: SkinSurface) -> IntArray:
    """Mesh nodes that the probe loads, ascending.

    With the gap law at contact points, those that carry a force. Integrated over faces, all nodes of the faces that
    carry pressure: under a uniform one the force on a vertex is nothing, though it is pressed as its midpoints are.
    """
    if at.contact is not None and at.contact.pressed is not None:
        chosen = at.contact.pressed
        return np.unique(skin.nodes[chosen][skin.weights[chosen] != 0.0])
    return np.flatnonzero(np.abs(at.external).max(axis=1) > NO_FORCE)


class _Recorder:
    """Collects the arrays of a `Simulation`."""

    def __init__(self, contact: ContactModel, system: ElasticSystem, n_steps: int) -> None:
        self.contact, self.system = contact, system
        n, k = system.mesh.n_nodes, system.mesh.n_parts
        self.displacement = np.zeros((n_steps, n, 3), dtype=np.float32)
        self.wrench = np.zeros((n_steps, 6))
        self.rotation = np.tile(np.eye(3), (n_steps, k, 1, 1))
        self.translation, self.part_wrench = np.zeros((n_steps, k, 3)), np.full((n_steps, k, 6), np.nan)
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
        self, step: int, at: Balance, pose: ProbePose, near: IntArray, *, residual: float, iterations: int,
        seconds: float,
    ) -> None:
        """Record a converged step; `near` are the skin vertices within the alarm distance."""
        points = at.state.points
        self.displacement[step] = points - self.system.mesh.node_points
        self.wrench[step, :3] = at.external.sum(axis=0)
        self.wrench[step, 3:] = np.cross(points - pose.translation, at.external).sum(axis=0)
        self.rotation[step], self.translation[step] = at.state.rotation, at.state.translation
        joints = self.system.joints.gradient(at.state.rotation, at.state.translation)
        self.part_wrench[step] = -self.system.part_wrench(at.internal + at.external, at.state) - joints
        self.scalars["residual"][step] = residual
        self.scalars["energy"][step] = self.system.energy(at.state)
        self.scalars["min_jacobian"][step] = self.system.min_jacobian(at.state)
        self.scalars["penetration"][step] = at.contact.penetration if at.contact else 0.0
        self.scalars["seconds"][step] = seconds
        self.converged[step], self.iterations[step] = True, iterations
        skin = self.contact.skin
        listed = np.unique(skin.nodes[near][skin.weights[near] != 0.0])
        loaded = loaded_nodes(at, skin)
        nodes = np.union1d(listed, loaded).astype(np.int64)
        forces = -at.external[nodes]
        forces[~np.isin(nodes, loaded)] = 0.0
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
            iterations=self.iterations, part_wrench=self.part_wrench, **self.scalars,
        )
