"""ElasticSystem: soft tetrahedra with rigid parts inside, as energy, gradient and tangent of one set of unknowns."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from mixpinn.base.arrays import AnyArray, BoolArray, FloatArray, IntArray
from mixpinn.base.errors import InputError
from mixpinn.fem.elements import assembly
from mixpinn.fem.elements.cells import ElasticCells
from mixpinn.fem.elements.input_check import check_elastic_input
from mixpinn.fem.elements.pattern import NodePairs, Reduction
from mixpinn.fem.elements.ranges import RangeRunner
from mixpinn.fem.material.hyperelastic import Material
from mixpinn.fem.rigid.parts import RigidParts, geometric_stiffness
from mixpinn.geometry.rotations import orthonormalise, rotation_from_vector, vector_from_rotation
from mixpinn.geometry.tetrahedra import shape_gradients
from mixpinn.physics import linear_tetrahedron, quadratic_tetrahedron
from mixpinn.physics.foundation import Foundation, FoundationSystem
from mixpinn.physics.joint_system import Joint, JointSystem
from mixpinn.physics.membrane import Membrane, MembraneSystem
from mixpinn.physics.quadrature import TETRAHEDRON_4, Quadrature
from mixpinn.records import TissueMesh

Blocks = tuple[IntArray, IntArray, FloatArray]
"""External stiffness: nodes i (b,), nodes j (b,), blocks ∂²E/∂x_i ∂x_j (b, 3, 3) [N/mm]."""


@dataclass(frozen=True, eq=False)
class State:
    """A configuration of n nodes and K rigid parts.

    Attributes:
        points: current positions [mm], shape (n, 3).
        rotation: rotation matrix of each rigid part, shape (K, 3, 3).
        translation: displacement of the centroid (mean of the vertices) of each rigid part [mm], shape (K, 3).
    """

    points: FloatArray
    rotation: FloatArray
    translation: FloatArray


class ElasticSystem:
    """The elastic energy E of a mesh as a function of its reduced unknowns.

    Unknowns are three displacements per free soft node (in the order of the nodes), then per rigid part the
    translation of its centroid and a spatial rotation vector, so that a node of the part moves as
    δx = δt + δw × d, d = x − centroid. Fixed nodes have none. Cells that no unknown deforms are left out.

    Rotations are updated exactly, R ← exp([w]) R, and so the second derivative depends on how it is meant: the
    tangent is the Hessian of E∘`advance` at zero increment, symmetric as every Hessian is. The derivative of the
    reduced gradient from state to state differs from it by −½ [m] in each part's rotation block, m the net moment
    on the part (the skew half of Σ d gᵀ − (d·g) 1, whose symmetric half is kept); it vanishes at equilibrium, which
    leaves Newton's convergence quadratic.

    Args:
        mesh: the tissue mesh; its `order` decides between four-node and ten-node cells. Nodes are those of the mesh:
            vertices, followed by the midpoints of the edges where the order is 2.
        materials: one per entry of `mesh.tissue_names`.
        extra_pairs: pairs of nodes that external blocks may couple beyond the edges of the mesh, shape (p, 2).
        threads: threads of the assembly; results do not depend on it.
        quadrature: of ten-node cells.
        joints: between the rigid parts; their energy belongs to E.
        foundations: under the skin; their energy belongs to E.
        membrane: of the skin; its energy belongs to E.

    Raises:
        InputError: wrong number of materials, inverted cells, a rigid part of which some nodes are fixed, or without
            nodes, a soft node without a cell, a joint of a part that is not there.

    The six unknowns of a rigid part whose nodes are all fixed are there and stay zero: their residual is zero, their
    rows and columns of the tangent are those of the unit matrix.

    An instance keeps work arrays: it serves one caller at a time.

    Example:
        >>> from mixpinn.fem import PAPER_TISSUE, default_solver
        >>> system, solver = ElasticSystem(mesh, [PAPER_TISSUE]), default_solver()
        >>> state, load = system.rest_state(), np.zeros((mesh.n_points, 3))  # [N]
        >>> residual = system.residual(system.gradient(state) - load, state)
        >>> solver.factorize(system.tangent(state))
        >>> state = system.advance(state, -solver.solve(residual))
        >>> bool(np.allclose(state.points, mesh.points))  # no load, no motion
        True
    """

    def __init__(
        self, mesh: TissueMesh, materials: Sequence[Material], *, extra_pairs: IntArray | None = None, threads: int = 1,
        quadrature: Quadrature = TETRAHEDRON_4, joints: Sequence[Joint] = (), foundations: Sequence[Foundation] = (),
        membrane: Membrane | None = None,
    ) -> None:
        check_elastic_input(mesh, len(materials), extra_pairs)
        self.mesh = mesh
        self.materials = tuple(materials)
        self._run = RangeRunner(threads)
        self._rest = np.ascontiguousarray(mesh.node_points, dtype=np.float64)
        self._part = np.asarray(mesh.node_part, dtype=np.int64)
        self._fixed = mesh.node_fixed
        self._rigid = RigidParts(self._rest, self._part, mesh.n_parts, n_vertices=mesh.n_points)
        self.joints = JointSystem(joints, mesh.rigid_names, self._rigid.centroids)
        self.foundations = FoundationSystem(tuple(foundations), mesh)
        self.membrane = MembraneSystem(membrane, mesh)

        # Sorted, ten nodes are four vertices and the midpoints of their pairs in ascending order.
        self._all_cells = np.sort(np.asarray(mesh.cell_nodes, dtype=np.int64), axis=1)
        self._all_gradients, _ = shape_gradients(self._rest, self._all_cells[:, :4])
        self._places = quadrature.points
        deforms = mesh.deforming_cells
        self._elastic = ElasticCells(
            self._rest, self._all_cells[deforms], mesh.tissue[deforms], materials, self._run, quadrature=quadrature,
        )
        extra = np.empty((0, 2), dtype=np.int64) if extra_pairs is None else np.asarray(extra_pairs, dtype=np.int64)
        self._pairs = NodePairs.build(len(self._rest), self._elastic.cells, np.concatenate([mesh.edges, extra]))
        self._reduction = Reduction.build(self._pairs, self._part, self._fixed, mesh.n_parts)
        self.locked: BoolArray = np.zeros(self.n_dofs, dtype=bool)
        self.locked[self.n_dofs - 6 * mesh.n_parts:] = np.repeat(mesh.held_parts, 6)
        self._blocks = np.empty((len(self._pairs.codes), 3, 3))
        self._diagonals = np.empty((len(self._rest), 3, 3))

    @property
    def n_dofs(self) -> int:
        """Number of unknowns: 3 per free soft node, then 6 per rigid part."""
        return self._reduction.n_dofs

    @property
    def free_nodes(self) -> IntArray:
        """The free soft nodes in the order of their unknowns."""
        return self._reduction.soft_nodes

    def rest_state(self) -> State:
        """The undeformed configuration."""
        n_parts = len(self._rigid)
        return State(self._rest.copy(), np.tile(np.eye(3), (n_parts, 1, 1)), np.zeros((n_parts, 3)))

    def place(self, points: FloatArray, rotation: FloatArray, translation: FloatArray) -> State:
        """State with soft nodes at `points` and rigid parts at the given poses; fixed nodes stay at rest.

        Args:
            points: positions [mm], shape (n, 3); entries of rigid and fixed nodes are ignored.
            rotation: shape (K, 3, 3).
            translation: displacement of the centroids [mm], shape (K, 3).
        """
        points = np.array(points, dtype=np.float64)
        points[self._fixed] = self._rest[self._fixed]
        self._rigid.place(points, rotation, translation)
        return State(points, np.array(rotation, dtype=np.float64), np.array(translation, dtype=np.float64))

    def advance(self, state: State, increment: FloatArray) -> State:
        """`state` moved by `increment` (n_dofs,) [mm, rad]: R ← exp([w]) R, rigid nodes at c + t + R (X − c)."""
        soft, twist = self._split(increment)
        points = state.points.copy()
        points[self.free_nodes] += soft
        rotation = orthonormalise(rotation_from_vector(twist[:, 3:]) @ state.rotation)
        return self.place(points, rotation, state.translation + twist[:, :3])

    def difference(self, start: State, end: State) -> FloatArray:
        """The increment that `advance` needs from `start` to `end`, shape (n_dofs,) [mm, rad]."""
        turn = vector_from_rotation(end.rotation @ np.swapaxes(start.rotation, 1, 2))
        twist = np.concatenate([end.translation - start.translation, turn], axis=1)
        return np.concatenate([(end.points - start.points)[self.free_nodes].ravel(), twist.ravel()])

    def expand(self, increment: FloatArray, state: State) -> FloatArray:
        """Linearised displacement of every node for an increment, J δ: [mm], shape (n, 3); transpose of `reduce`."""
        soft, twist = self._split(increment)
        moved = np.zeros_like(state.points)
        moved[self.free_nodes] = soft
        self._rigid.expand(twist, self._rigid.arms(state.points, state.translation), moved)
        return moved

    def energy(self, state: State) -> float:
        """Elastic energy E of cells, joints, foundations and membrane [N mm], zero at rest."""
        energy = self._elastic.energy(state.points) + self.joints.energy(state.rotation, state.translation)
        for under in (self.foundations, self.membrane):
            if len(under):
                energy += under.energy(state.points - self._rest)
        return energy

    def gradient(self, state: State) -> FloatArray:
        """Gradient of the energy but that of joints at every node, fixed and rigid ones included [N], shape (n, 3).

        Joints act on parts, not on nodes: `residual` has them.
        """
        gradient = self._elastic.gradient(state.points)
        for under in (self.foundations, self.membrane):
            if len(under):
                under.add_forces(state.points - self._rest, gradient)
        return gradient

    def residual(self, nodal: FloatArray, state: State) -> FloatArray:
        """`reduce` of a nodal gradient (n, 3) [N], and the joints' part of ∂E/∂q; shape (n_dofs,) [N, N mm]."""
        residual = self.reduce(nodal, state)
        if len(self.joints):
            residual[self.n_dofs - 6 * len(self._rigid):] += self.joints.gradient(
                state.rotation, state.translation,
            ).ravel()
            residual[self.locked] = 0.0
        return residual

    def reduce(self, nodal: FloatArray, state: State) -> FloatArray:
        """Jᵀ g: nodal gradients or forces (n, 3) [N] on the unknowns, shape (n_dofs,) [N, N mm]."""
        reduced = np.concatenate([nodal[self.free_nodes].ravel(), self.part_wrench(nodal, state).ravel()])
        reduced[self.locked] = 0.0
        return reduced

    def part_wrench(self, nodal: FloatArray, state: State) -> FloatArray:
        """Net force [N] and moment about the current centroid [N mm] of each rigid part, shape (K, 6)."""
        return self._rigid.wrench(nodal, state.points, state.translation)

    def tangent(
        self, state: State, *, nodal_gradient: FloatArray | None = None, blocks: Blocks | None = None,
        held: BoolArray | None = None, project: bool = True,
    ) -> sp.csr_matrix:
        """Upper triangle of the Hessian of the total energy with respect to the unknowns.

        Args:
            state: where.
            nodal_gradient: total nodal gradient, internal and external [N], shape (n, 3), for the geometric term of
                the rotations; by default the elastic one.
            blocks: external stiffness. Each unordered pair of nodes is given once, in either order, and stands for
                the block and its transpose; repetitions add up; of i = j the symmetric part counts. Nodes may be
                soft, rigid or fixed. Pairs must be edges of the mesh or among `extra_pairs`.
            held: unknowns whose row and column become zero, with a unit diagonal, shape (n_dofs,).
            project: lift negative eigenvalues of each cell's and joint's tangent to zero, so that their sum is positive
                semi-definite but for the geometric term; False gives the exact tangent.

        Returns:
            Shape (n_dofs, n_dofs); `indptr` and `indices` are the same arrays at every call.

        Raises:
            InputError: an external pair outside the pattern.
        """
        pairs, reduction = self._pairs, self._reduction
        self._elastic.stiffness(state.points, pairs, project, self._blocks, self._diagonals)
        if blocks is not None:
            self._add(blocks)
        if len(self.foundations):
            self.foundations.add_stiffness(state.points - self._rest, self._diagonals)
        if len(self.membrane):
            self._add(self.membrane.stiffness(state.points - self._rest, project=project))
        arms = self._rigid.arms(state.points, state.translation)
        data = np.empty(reduction.nnz)
        n_soft = len(reduction.soft_nodes)
        self._run(
            assembly.fill_soft_rows, n_soft, reduction.soft_nodes, self._part, arms, pairs.offsets, pairs.nodes,
            pairs.ids, reduction.entry_offset, self._blocks, self._diagonals, reduction.indptr, data,
        )
        if len(self._rigid):
            dense = np.zeros((6 * len(self._rigid), 6 * len(self._rigid)))
            assembly.reduce_rigid(
                self._rigid.nodes, self._part, arms, pairs.offsets, pairs.nodes, pairs.ids, self._blocks,
                self._diagonals, dense,
            )
            nodal = self.gradient(state) if nodal_gradient is None else nodal_gradient
            for k, nodes in enumerate(self._rigid.by_part):
                turning = slice(6 * k + 3, 6 * k + 6)
                dense[turning, turning] += geometric_stiffness(arms[nodes], nodal[nodes])
            self.joints.add_tangent(state.rotation, state.translation, dense, project=project)
            data[reduction.indptr[3 * n_soft]:] = dense[np.triu_indices(len(dense))]
        matrix = self._matrix(data)
        if held is not None or self.locked.any():
            self._hold(matrix, self.locked if held is None else held | self.locked)
        return matrix

    def hold(self, matrix: sp.csr_matrix, held: BoolArray) -> sp.csr_matrix:
        """Copy of a tangent with rows and columns of the `held` unknowns (n_dofs,) zero and their diagonal one.

        To impose increments δ on them, solve with the right-hand side r − K δ (`symmetric_product` with the matrix
        that is not yet held) on the free unknowns and δ on the held ones.
        """
        matrix = self._matrix(matrix.data.copy())
        self._hold(matrix, held)
        return matrix

    def node_dofs(self, nodes: AnyArray) -> IntArray:
        """Unknown of each component of each node, −1 for fixed and rigid nodes; shape (len(nodes), 3)."""
        index = self._reduction.soft_index[np.asarray(nodes, dtype=np.int64)]
        return np.where(index[:, None] < 0, -1, 3 * index[:, None] + np.arange(3))

    def jacobians(self, state: State) -> FloatArray:
        """J = det F of every cell of the mesh, shape (m,): the smallest at the quadrature points of ten-node cells."""
        if self.mesh.order == 2:
            return self._jacobians_at(state, self._places).min(axis=1)
        values = np.empty(len(self._all_cells))
        moved = state.points - self._rest
        self._run(
            linear_tetrahedron.cell_jacobians, len(values), self._all_cells, moved, self._all_gradients, values,
        )
        return values

    def vertex_jacobians(self, state: State) -> FloatArray:
        """The smallest det F at the vertices of every cell of the mesh, shape (m,); linear cells have one det F."""
        return self.jacobians(state) if self.mesh.order == 1 else self._jacobians_at(state, np.eye(4)).min(axis=1)

    def _jacobians_at(self, state: State, places: FloatArray) -> FloatArray:
        values = np.empty((len(self._all_cells), len(places)))
        self._run(
            quadratic_tetrahedron.cell_jacobians, len(values), self._all_cells, state.points - self._rest,
            self._all_gradients, places, values,
        )
        return values

    def min_jacobian(self, state: State) -> float:
        """Smallest det F over the cells, at the quadrature points of ten-node ones."""
        return float(self.jacobians(state).min())

    def _add(self, blocks: Blocks) -> None:
        first, second = (np.asarray(nodes, dtype=np.int64) for nodes in blocks[:2])
        ids, known = self._pairs.find(first, second)
        if not known.all():
            raise InputError(
                "external stiffness", expected="pairs that are edges of the mesh or extra_pairs",
                got=f"nodes {first[~known][0]} and {second[~known][0]}", fix="name the pair in extra_pairs",
            )
        values = np.ascontiguousarray(blocks[2], dtype=np.float64)
        assembly.add_blocks(first, second, ids, values, self._blocks, self._diagonals)

    def _hold(self, matrix: sp.csr_matrix, held: BoolArray) -> None:
        self._run(assembly.hold_rows, self.n_dofs, held, self._reduction.indptr, self._reduction.indices, matrix.data)

    def _matrix(self, data: FloatArray) -> sp.csr_matrix:
        shape = (self.n_dofs, self.n_dofs)
        return sp.csr_matrix((data, self._reduction.indices, self._reduction.indptr), shape=shape, copy=False)

    def _split(self, increment: FloatArray) -> tuple[FloatArray, FloatArray]:
        n_soft = 3 * len(self.free_nodes)
        return increment[:n_soft].reshape(-1, 3), increment[n_soft:].reshape(-1, 6)
