"""What coarse cells along the border of the held skin miss, told from the forces of contact.

Where skin stops being held, displacements go like the root of the distance from that line, so that cells of size h miss
an energy of order h (as under a sharp rim, `mixpinn.fem.local_refinement`): along a line as long as the body, which no
mesh resolves. Strains are small there, and the body answers the forces of a press as linear elasticity has it. So the
body at rest is solved on the mesh as it is and on two meshes whose cells are halved along the border until no edge
there is longer than 2e and than e, with the contact forces f of every step for loads: with K the stiffness,

    d = (2 K_e⁻¹ − K_2e⁻¹ − K⁻¹) f

is what a step lacks at the same forces. The probe stands where it stands, and skin sticks to it from where it was
first touched: forces that push and turn contact as a whole, spread like those of the step, bring it back to there in
the mean, and the body's answer to them on the mesh as it is belongs to the correction. Skin that slides is not told
apart.
"""

from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from mixpinn.base.arrays import FloatArray, IntArray
from mixpinn.fem.elements.system import ElasticSystem
from mixpinn.fem.local_refinement import refine_around
from mixpinn.fem.scene import Scene
from mixpinn.fem.solve.linear import default_solver
from mixpinn.fem.solve.scene_models import elastic_system
from mixpinn.records import Simulation, TissueMesh
from mixpinn.records.triangle_edges import border_edges

_SPACING = 2.0
"""Of the points that stand for the border [mm]."""

_GROWTH = 1.0
"""An edge may be longer by its distance from the border."""

_SHARE = 0.25
"""Edges along the border are made shorter than this part of the longest there, whatever length is asked for."""


def held_border(mesh: TissueMesh) -> FloatArray:
    """Points along the line where held skin meets skin that is not, or ends [mm], shape (p, 3)."""
    ends = _border_edges(mesh)
    first, last = mesh.points[ends[:, 0]], mesh.points[ends[:, 1]]
    longest = np.linalg.norm(last - first, axis=1).max(initial=0.0)
    along = np.linspace(0.0, 1.0, 2 + int(longest / _SPACING))
    points: FloatArray = (first[:, None] + along[:, None] * (last - first)[:, None]).reshape(-1, 3)
    return points


def _border_edges(mesh: TissueMesh) -> IntArray:
    faces = mesh.skin_faces[mesh.fixed[mesh.skin_faces].all(axis=1)]
    return border_edges(faces)


def finer_border(mesh: TissueMesh, edge: float) -> TissueMesh:
    """The mesh with cells halved along the border until no edge there is longer than `edge` [mm]."""
    return refine_around(mesh, held_border(mesh), edge=edge, growth=_GROWTH)


class _Body:
    """A scene's body at rest, on a mesh that has all nodes of the scene's: displacements u = J q, q = K⁻¹ Jᵀ f."""

    def __init__(self, scene: Scene, mesh: TissueMesh) -> None:
        base = scene.mesh
        system: ElasticSystem = elastic_system(replace(scene, mesh=mesh, refinement=None))
        self._solver = default_solver(scene.solver.threads, single=True)
        self._solver.factorize(system.tangent(system.rest_state(), project=False))
        self._free = ~system.locked
        self._motion = _motion(system, base)
        self._shift = np.array([
            np.subtract(*(some.points[some.part_nodes(k)].mean(axis=0) for some in (base, mesh)))
            for k in range(1, base.n_parts + 1)
        ]).reshape(-1, 3)

    def response(self, forces: list[tuple[IntArray, FloatArray]]) -> tuple[FloatArray, FloatArray]:
        """Displacement of the scene's nodes [mm] (s, n, 3) and twists of its parts about their centroids (s, K, 6)."""
        loads = np.zeros((len(forces), self._motion.shape[0] // 3, 3))
        for row, (nodes, force) in enumerate(forces):
            loads[row, nodes] = force
        reduced = self._free[:, None] * (self._motion.T @ loads.reshape(len(forces), -1).T)
        found = np.asarray(self._solver.solve(reduced)).reshape(reduced.shape)
        twist = found[len(found) - 6 * len(self._shift):].T.reshape(len(forces), -1, 6).copy()
        twist[..., :3] += np.cross(twist[..., 3:], self._shift)
        return (self._motion @ found).T.reshape(loads.shape), twist


def _motion(system: ElasticSystem, base: TissueMesh) -> sp.csr_matrix:
    """J at rest, of the nodes of `base`, which are among those of the system's mesh, shape (3 n, n_dofs)."""
    mesh = system.mesh
    node = cKDTree(mesh.node_points).query(base.node_points)[1]
    own, columns = np.nonzero(system.node_dofs(node) >= 0)
    rows, values = [3 * own + columns], [np.ones(len(own))]
    dofs = [system.node_dofs(node)[own, columns]]
    for k in range(1, mesh.n_parts + 1):
        bone = np.flatnonzero(base.node_part == k)
        arm = base.node_points[bone] - mesh.points[mesh.part_nodes(k)].mean(axis=0)
        first = system.n_dofs - 6 * (mesh.n_parts - k + 1)
        turns = np.stack([np.cross(axis, arm) for axis in np.eye(3)], axis=2)
        moves = np.concatenate([np.broadcast_to(np.eye(3), turns.shape), turns], axis=2)
        rows.append(np.repeat(3 * bone[:, None] + np.arange(3), 6))
        dofs.append(np.tile(first + np.arange(6), 3 * len(bone)))
        values.append(moves.ravel())
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(dofs)))
    return sp.csr_matrix(entries, shape=(3 * base.n_nodes, system.n_dofs))


class HeldBorder:
    """The correction of a scene's poses.

    Args:
        scene: whose mesh the poses are told on.
        edge: e, longest edge along the border on the finest mesh [mm]; at most a fourth of the longest there is.
    """

    def __init__(self, scene: Scene, edge: float) -> None:
        self._mesh = mesh = scene.mesh
        ends = mesh.points[_border_edges(mesh)]
        longest = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).max(initial=0.0)
        self._bodies: list[_Body] = []
        if len(ends):
            edge = min(edge, _SHARE * longest)
            meshes = [mesh, finer_border(mesh, 2.0 * edge), finer_border(mesh, edge)]
            self._bodies = [_Body(scene, some) for some in meshes]

    def corrected(self, found: Simulation) -> Simulation:
        """A simulation on the nodes of the scene's mesh, as it would be with cells of no length along the border."""
        steps = [int(step) for step in found.sample_steps()]
        if not self._bodies or not steps:
            return found
        forces = [found.contacts(step, loaded=False) for step in steps]
        units = [_unit_loads(self._mesh.node_points[nodes], force) for nodes, force in forces]
        every = [(nodes, force) for (nodes, _), unit in zip(forces, units, strict=True) for force in unit]
        (coarse, coarse_twist), (fine, fine_twist) = (body.response(forces) for body in self._bodies[1:])
        (as_is, twist), (held, held_twist) = (self._bodies[0].response(loads) for loads in (forces, every))
        more, twist = 2.0 * fine - coarse - as_is, 2.0 * fine_twist - coarse_twist - twist
        displacement, nodal = found.displacement.astype(np.float64), found.contact_forces.copy()
        rotation, translation = found.part_rotation.copy(), found.part_translation.copy()
        wrench, scale = found.probe_wrench.copy(), np.ones(found.n_steps)
        since, last = np.full(displacement.shape[1:], np.nan), np.zeros(displacement.shape[1:])
        for row, (step, (nodes, force), unit) in enumerate(zip(steps, forces, units, strict=True)):
            own, stuck = slice(6 * row, 6 * row + 6), nodes[force.any(axis=1)]
            before = np.where(np.isnan(since[stuck]), last[stuck], since[stuck])
            since[:] = np.nan
            since[stuck] = before
            axis = found.path.rotations[step][:, 1]
            target = np.nan_to_num(since[nodes])
            target -= (target @ axis)[:, None] * axis
            share = _held_still(unit, held[own, nodes], more[row, nodes] - target)
            moved = more[row] + np.tensordot(share, held[own], axes=1)
            turned = twist[row] + np.tensordot(share, held_twist[own], axes=1)
            added = np.tensordot(share, unit, axes=1)
            nodal[slice(*found.contact_offsets[step : step + 2])] += added
            displacement[step] += moved
            last = moved
            translation[step] += turned[:, :3]
            rotation[step] = Rotation.from_rotvec(turned[:, 3:]).as_matrix() @ rotation[step]
            place_parts(self._mesh, displacement[step], rotation[step], translation[step])
            at = self._mesh.node_points[nodes] + displacement[step, nodes] - found.path.translations[step]
            wrench[step, :3] -= added.sum(axis=0)
            wrench[step, 3:] -= np.cross(at, added).sum(axis=0)
            scale[step] += float((added * force).sum() / (force**2).sum())
        return replace(
            found, displacement=displacement.astype(np.float32), part_rotation=rotation, part_translation=translation,
            contact_forces=nodal, energy=scale * found.energy, probe_wrench=wrench,
            part_wrench=None if found.part_wrench is None else scale[:, None, None] * found.part_wrench,
        )


def _unit_loads(points: FloatArray, force: FloatArray) -> FloatArray:
    """Loads on contact nodes (c, 3) by which it is pushed and turned as a whole, shape (6, c, 3).

    They are spread like the forces of contact: 1 N along each axis, and forces of a turn about their centre.
    """
    weight = np.linalg.norm(force, axis=1)
    weight = weight / weight.sum()
    arm = points - weight @ points
    size = max(float(np.sqrt(weight @ (arm**2).sum(axis=1))), 1e-9)
    pushes = [np.broadcast_to(axis, arm.shape) for axis in np.eye(3)]
    turns = [np.cross(axis, arm) / size for axis in np.eye(3)]
    loads: FloatArray = weight[:, None] * np.array([*pushes, *turns])
    return loads


def _held_still(unit: FloatArray, response: FloatArray, moved: FloatArray) -> FloatArray:
    """Shares of unit loads (6, c, 3) whose responses (6, c, 3) bring contact back that has `moved` (c, 3); shape (6,).

    Loads of a few nodes in a row turn nothing about it; the shortest shares are taken.
    """
    work = np.einsum("ick,jck->ij", unit, response)
    shares: FloatArray = np.linalg.lstsq(work, -np.einsum("ick,ck->i", unit, moved), rcond=1e-6)[0]
    return shares


def place_parts(mesh: TissueMesh, displacement: FloatArray, rotation: FloatArray, translation: FloatArray) -> None:
    """Move the nodes of rigid parts in `displacement` [mm] (n, 3) as rotation (K, 3, 3) and translation (K, 3) say."""
    for k in range(mesh.n_parts):
        bone = np.flatnonzero(mesh.node_part == k + 1)
        arm = mesh.node_points[bone] - mesh.points[mesh.part_nodes(k + 1)].mean(axis=0)
        displacement[bone] = translation[k] + arm @ (rotation[k] - np.eye(3)).T


def held_border_of(scene: Scene, edge: float) -> HeldBorder:
    """The correction of `scene`; the last one is kept, as it depends on the body alone."""
    global _kept
    key = f"{replace(scene, refinement=None).hash()} {edge:g}"
    if _kept is None or _kept[0] != key:
        _kept = (key, HeldBorder(scene, edge))
    return _kept[1]


_kept: tuple[str, HeldBorder] | None = None
