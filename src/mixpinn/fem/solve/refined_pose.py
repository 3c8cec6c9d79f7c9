"""Poses solved on cells that are finer under the probe, and told on the nodes of the scene's own mesh.

Each pose has a mesh of its own (`mixpinn.fem.local_refinement`). The spaces of the shape functions are nested: every
node of the scene's mesh is one of the finer mesh, and forces on the finer skin are handed to the scene's nodes by its
shape functions, which leaves force, moment and virtual work as they are.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import count

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from mixpinn.base.arrays import FloatArray, IntArray
from mixpinn.fem.local_refinement import LocalRefinement, refine_under
from mixpinn.fem.nested_faces import face_functions, owning_faces
from mixpinn.fem.scene import Scene
from mixpinn.fem.solve.held_border import held_border_of, place_parts
from mixpinn.fem.solve.pose_simulator import PoseSimulator, simulator_of
from mixpinn.records import ProbePath, Simulation, TissueMesh

_SAME = 1e-6
"""A node of the scene's mesh and one of the finer mesh that are closer than this are one [mm]."""


class RefinedSimulator:
    """Simulates poses of a scene, each on cells of its own; results are on the nodes of the scene's mesh."""

    def __init__(self, scene: Scene) -> None:
        """Prepare for poses of a scene with a refinement."""
        self.scene = scene

    def run(
        self, path: ProbePath, *, position_index: int = 0, rotation_deg: float = 0.0,
        on_step: Callable[[int], None] | None = None,
    ) -> Simulation:
        """Simulate one pose; arguments and errors of `PoseSimulator.run`."""
        config = self.scene.refinement
        assert config is not None
        solves, done = 2 if config.extrapolated else 1, count()

        def told(_: int) -> None:
            """Steps of all solves, as a share of those of the path."""
            if on_step is not None:
                on_step(next(done) // solves)

        solve = partial(self._solve, path, position_index=position_index, rotation_deg=rotation_deg, on_step=told)
        if not config.extrapolated:
            return solve(config)
        coarser = solve(config.scaled(config.ratio))
        assert config.order is not None  # a scene's refinement has the order of its tool
        found = extrapolate(self.scene.mesh, coarser, solve(config), ratio=config.ratio, order=config.order)
        return found if config.held is None else held_border_of(self.scene, config.held).corrected(found)

    def _solve(
        self, path: ProbePath, config: LocalRefinement, *, position_index: int, rotation_deg: float,
        on_step: Callable[[int], None],
    ) -> Simulation:
        base = self.scene.mesh
        fine = refine_under(base, self.scene.probe, path, config)
        simulator = PoseSimulator(replace(self.scene, mesh=fine, refinement=None))
        found = simulator.run(path, position_index=position_index, rotation_deg=rotation_deg, on_step=on_step)
        return Injection(base, fine).simulation(found)


def simulate_pose(
    scene: Scene, path: ProbePath, *, position_index: int, rotation_deg: float,
    on_step: Callable[[int], None] | None = None,
) -> Simulation:
    """Simulate one pose of `scene`; the preparation for the last scene is kept for the next call."""
    simulator = simulator_of(scene) if scene.refinement is None else RefinedSimulator(scene)
    return simulator.run(path, position_index=position_index, rotation_deg=rotation_deg, on_step=on_step)


class Injection:
    """From the nodes of a finer mesh to those of the mesh that it was made from."""

    def __init__(self, base: TissueMesh, fine: TissueMesh) -> None:
        """Find the nodes of `base` among those of `fine`, and the faces of the one that those of the other are of."""
        self.base, self.fine = base, fine
        distance, self.node = cKDTree(fine.node_points).query(base.node_points)
        assert distance.max(initial=0.0) < _SAME
        self._skin = np.unique(fine.skin_node_faces)
        corners, faces = np.ascontiguousarray(base.points), np.ascontiguousarray(base.skin_faces)
        self._face_of_node = owning_faces(fine.node_points[self._skin], corners, faces)
        self._face_of_face = owning_faces(fine.points[fine.skin_faces].mean(axis=1), corners, faces)
        weights = face_functions(fine.node_points[self._skin], corners[faces[self._face_of_node]], base.order)
        nodes = base.skin_node_faces[self._face_of_node]
        rows = np.repeat(self._skin, nodes.shape[1])
        self._interpolation = sp.csr_matrix(
            (weights.ravel(), (rows, nodes.ravel())), shape=(fine.n_nodes, base.n_nodes),
        )

    def forces(self, nodal: FloatArray) -> FloatArray:
        """Forces on the nodes of the finer skin (n_fine, 3) as forces on the nodes of the mesh, (n, 3) [N]."""
        found: FloatArray = self._interpolation.T @ nodal
        return found

    def nodes(self, chosen: IntArray) -> IntArray:
        """Nodes of the faces of which a finer face has all its nodes among `chosen` ones of the finer mesh."""
        among = np.flatnonzero(np.isin(self.fine.skin_node_faces, chosen).all(axis=1))
        return np.unique(self.base.skin_node_faces[self._face_of_face[among]])

    def simulation(self, found: Simulation) -> Simulation:
        """What was simulated on the finer mesh, on the nodes of the mesh."""
        nodes, forces = [], []
        for step in range(found.n_steps):
            some = slice(*found.contact_offsets[step : step + 2])
            near, load = found.contact_nodes[some], found.contact_forces[some]
            nodal = np.zeros((self.fine.n_nodes, 3))
            nodal[near] = load
            whole = self.forces(nodal)
            loaded = np.flatnonzero(np.abs(whole).max(axis=1) > 0.0)
            nodes.append(np.union1d(self.nodes(near), loaded).astype(np.int64))
            forces.append(whole[nodes[-1]])
        shift = np.array([
            np.subtract(*(mesh.points[mesh.part_nodes(k)].mean(axis=0) for mesh in (self.base, self.fine)))
            for k in range(1, self.base.n_parts + 1)
        ]).reshape(-1, 3)
        moved = np.einsum("skij,kj->ski", found.part_rotation, shift) - shift
        wrench = found.part_wrench
        if wrench is not None:  # its moments are about other centroids there
            arm = np.einsum("skij,kj->ski", found.part_rotation, shift)
            wrench = np.concatenate([wrench[..., :3], wrench[..., 3:] - np.cross(arm, wrench[..., :3])], axis=2)
        return replace(
            found, mesh_hash=self.base.hash(), displacement=found.displacement[:, self.node],
            contact_offsets=np.concatenate([[0], np.cumsum([len(some) for some in nodes])]).astype(np.int64),
            contact_nodes=np.concatenate([*nodes, np.empty(0, dtype=np.int64)]),
            contact_forces=np.concatenate([*forces, np.empty((0, 3))]),
            part_translation=found.part_translation + moved, part_wrench=wrench,
        )


def extrapolate(mesh: TissueMesh, coarse: Simulation, fine: Simulation, *, ratio: float, order: float) -> Simulation:
    """What two simulations of one path tend to: u(h) + b (u(h) − u(q h)) with b = 1/(qᵖ − 1).

    Rotations go on along the turn from the one to the other, and the nodes of rigid parts move with them. What
    describes the solves (residual, iterations, smallest det F, violation of the gap, time) is the worse, or the sum.

    Args:
        mesh: of both.
        coarse, fine: on the nodes of `mesh`.
        ratio: q, how many times as long edges of the first are.
        order: p, with which the error falls.
    """
    beyond = 1.0 / (ratio**order - 1.0)

    def tend(one: FloatArray, other: FloatArray) -> FloatArray:
        return other + beyond * (other - one)

    turn = np.einsum("skij,sklj->skil", fine.part_rotation, coarse.part_rotation)
    further = beyond * Rotation.from_matrix(turn.reshape(-1, 3, 3)).as_rotvec()
    rotation = Rotation.from_rotvec(further).as_matrix().reshape(turn.shape) @ fine.part_rotation
    translation = tend(coarse.part_translation, fine.part_translation)
    displacement = tend(coarse.displacement.astype(np.float64), fine.displacement.astype(np.float64))
    for moved, turned, shifted in zip(displacement, rotation, translation, strict=True):
        place_parts(mesh, moved, turned, shifted)
    converged = coarse.converged & fine.converged
    displacement[~converged] = 0.0
    nodes, forces = [], []
    for step in np.flatnonzero(converged):
        ours, theirs = (found.contacts(int(step), loaded=False) for found in (fine, coarse))
        every = np.union1d(ours[0], theirs[0])
        force = np.zeros((len(every), 3))
        force[np.searchsorted(every, ours[0])] += (1.0 + beyond) * ours[1]
        force[np.searchsorted(every, theirs[0])] -= beyond * theirs[1]
        nodes.append(every)
        forces.append(force)
    counts = np.zeros(len(converged), dtype=np.int64)
    counts[converged] = [len(some) for some in nodes]
    wrench = None
    if fine.part_wrench is not None and coarse.part_wrench is not None:
        wrench = tend(coarse.part_wrench, fine.part_wrench)
    return replace(
        fine, displacement=displacement.astype(np.float32), part_rotation=rotation, part_translation=translation,
        part_wrench=wrench, probe_wrench=tend(coarse.probe_wrench, fine.probe_wrench),
        energy=tend(coarse.energy, fine.energy), converged=converged,
        contact_offsets=np.concatenate([[0], np.cumsum(counts)]),
        contact_nodes=np.concatenate([*nodes, np.empty(0, dtype=np.int64)]),
        contact_forces=np.concatenate([*forces, np.empty((0, 3))]),
        residual=np.fmax(fine.residual, coarse.residual), iterations=fine.iterations + coarse.iterations,
        min_jacobian=np.fmin(fine.min_jacobian, coarse.min_jacobian),
        penetration=np.fmax(fine.penetration, coarse.penetration), seconds=fine.seconds + coarse.seconds,
    )
