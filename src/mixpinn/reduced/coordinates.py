"""ReducedCoordinates: the unknowns of the mixed-material body, and how fields of the mesh are made of them.

Three displacements for each free soft node in ascending order, then translation of the centroid and rotation vector of
each rigid part: the unknowns of `mixpinn.fem.ElasticSystem`, without the solver.
"""

from functools import cached_property

import numpy as np
from numba import njit

from mixpinn.base.arrays import AnyArray, BoolArray, Float32Array, FloatArray, IntArray
from mixpinn.geometry.rigid_fit import fit_rotation
from mixpinn.geometry.rotations import rotation_from_vector, vector_from_rotation
from mixpinn.records import TissueMesh


class ReducedCoordinates:
    """Unknowns of a mesh with n nodes, s free soft nodes and K rigid parts; D = 3 s + 6 K.

    Nodes are those of the mesh: vertices, followed by the midpoints of the edges where its order is 2. A part's
    centroid is the mean of its vertices.

    Attributes:
        free: the free soft nodes, ascending, shape (s,).
        parts: nodes of each rigid part, ascending: its vertices come first.
        arms: rest position of each of their nodes less the part's centroid [mm], shapes (p, 3).
        vertices: how many of them are vertices.
        n_nodes: number of nodes n.
        n_vertices: how many of them, the first ones, are vertices; errors of fields are told over these.
        held: which parts are held in place: their twists stay zero, shape (K,).
    """

    def __init__(self, mesh: TissueMesh) -> None:
        self.free: IntArray = np.flatnonzero((mesh.node_part == 0) & ~mesh.node_fixed)
        self.parts: list[IntArray] = [np.flatnonzero(mesh.node_part == k + 1) for k in range(mesh.n_parts)]
        self.vertices: list[int] = [int((nodes < mesh.n_points).sum()) for nodes in self.parts]
        self.arms: list[FloatArray] = [
            mesh.node_points[nodes] - mesh.points[nodes[:count]].mean(axis=0)
            for nodes, count in zip(self.parts, self.vertices, strict=True)
        ]
        self.n_nodes, self.n_vertices = mesh.n_nodes, mesh.n_points
        ends = np.cumsum([0, *map(len, self.parts)])
        self._joined = (
            np.concatenate([np.zeros(0, np.int64), *self.parts]), np.concatenate([np.zeros((0, 3)), *self.arms]),
            ends[:-1], ends[1:], np.array(self.vertices, dtype=np.int64),
        )
        self.held: BoolArray = mesh.held_parts

    @property
    def size(self) -> int:
        """Number of unknowns D."""
        return 3 * len(self.free) + 6 * len(self.parts)

    @property
    def n_soft(self) -> int:
        """Number of soft unknowns 3 s; the twists follow them."""
        return 3 * len(self.free)

    @cached_property
    def weights(self) -> Float32Array:
        """√w with Σ w q² ≈ Σ_nodes |u|²: what an unknown weighs in displacements of nodes, shape (D,)."""
        weight = np.ones(self.size)
        for k, arm in enumerate(self.arms):
            twist = weight[self.n_soft + 6 * k:][:6]
            twist[:3] = np.sqrt(len(arm))
            squared = (arm**2).sum(axis=0)
            twist[3:] = np.sqrt(squared.sum() - squared)
        return weight.astype(np.float32)

    def twists(self, unknowns: AnyArray) -> FloatArray:
        """Translation [mm] and rotation vector [rad] of each part, shape (K, 6)."""
        return np.asarray(unknowns[self.n_soft:], dtype=np.float64).reshape(-1, 6)

    def expand(self, unknowns: AnyArray) -> Float32Array:
        """Displacement of every mesh node [mm], float32, shape (n, 3): rigid parts move by finite rotations.

        Args:
            unknowns: [mm, rad], shape (D,).
        """
        field = np.zeros((self.n_nodes, 3), dtype=np.float32)
        _spread(np.asarray(unknowns), self.free, field)
        self.place_parts(unknowns, field)
        return field

    def place_parts(self, unknowns: AnyArray, field: AnyArray) -> None:
        """Write the motion t + (R − 1) (X − c) of the rigid parts' nodes into `field` (n, 3), in its precision."""
        twists = self.twists(unknowns)
        turns = rotation_from_vector(twists[:, 3:]) - np.eye(3)
        nodes, arms, begins, ends, _ = self._joined
        _move_parts(nodes, arms, begins, ends, twists, turns, field)

    def gather(self, force: Float32Array, field: Float32Array) -> Float32Array:
        """Nodal forces by the unknowns [N, N mm], float32, shape (D,): the parts' net force and moment.

        Args:
            force: of every node [N], shape (n, 3).
            field: displacement of every node, with rigidly moved parts [mm], shape (n, 3). Moments are about the
                centroids of the parts' vertices there.
        """
        out = np.empty(self.size, dtype=np.float32)
        _gather(force, self.free, out)
        _wrenches(force, field, *self._joined, out[self.n_soft :].reshape(-1, 6))
        return out

    def project(self, field: AnyArray) -> FloatArray:
        """Unknowns [mm, rad], shape (D,), of a field [mm], shape (n, 3), that moves the parts rigidly.

        Rotations by least squares over a part's vertices (`fit_rotation`).
        """
        unknowns = np.empty(self.size)
        unknowns[: self.n_soft] = np.asarray(field)[self.free].ravel()
        for k, (nodes, arms, count) in enumerate(zip(self.parts, self.arms, self.vertices, strict=True)):
            arm = arms[:count]
            moved = arm + np.asarray(field, dtype=np.float64)[nodes[:count]]
            shift = moved.mean(axis=0)
            turn = vector_from_rotation(fit_rotation(arm, moved))
            unknowns[self.n_soft + 6 * k:][:6] = 0.0 if self.held[k] else [*shift, *turn]
        return unknowns


# mypy cannot see through numba's decorators: the kernels are untyped, their callers are not.


@njit(cache=True, nogil=True)
def _spread(unknowns, free, field):  # type: ignore[no-untyped-def]
    """The displacements of the free nodes into `field` (n, 3)."""
    for i in range(len(free)):
        row = field[free[i]]
        row[0], row[1], row[2] = unknowns[3 * i], unknowns[3 * i + 1], unknowns[3 * i + 2]


@njit(cache=True, nogil=True)
def _gather(field, free, out):  # type: ignore[no-untyped-def]
    """What the free nodes have in `field` (n, 3)."""
    for i in range(len(free)):
        row = field[free[i]]
        out[3 * i], out[3 * i + 1], out[3 * i + 2] = row[0], row[1], row[2]


@njit(cache=True, nogil=True)
def _move_parts(nodes, arms, begins, ends, twists, turns, field):  # type: ignore[no-untyped-def]
    """t + (R − 1) a for the nodes of each part."""
    for k in range(len(begins)):
        twist, turn = twists[k], turns[k]
        for i in range(begins[k], ends[k]):
            arm, row = arms[i], field[nodes[i]]
            for r in range(3):
                row[r] = twist[r] + turn[r, 0] * arm[0] + turn[r, 1] * arm[1] + turn[r, 2] * arm[2]


@njit(cache=True, nogil=True)
def _wrenches(force, field, nodes, arms, begins, ends, vertices, out):  # type: ignore[no-untyped-def]
    """Net force and moment Σ a × f about the mean of the vertices, which come first, of each part, (K, 6)."""
    centre, arm, total = np.empty(3), np.empty(3), np.empty(6)
    for k in range(len(begins)):
        centre[:] = 0.0
        for i in range(begins[k], begins[k] + vertices[k]):
            for r in range(3):
                centre[r] += (arms[i, r] + field[nodes[i], r]) / vertices[k]
        total[:] = 0.0
        for i in range(begins[k], ends[k]):
            f = force[nodes[i]]
            for r in range(3):
                arm[r] = arms[i, r] + field[nodes[i], r] - centre[r]
                total[r] += f[r]
            total[3] += arm[1] * f[2] - arm[2] * f[1]
            total[4] += arm[2] * f[0] - arm[0] * f[2]
            total[5] += arm[0] * f[1] - arm[1] * f[0]
        for r in range(6):
            out[k, r] = total[r]
