"""The Newton step behind an answer, with the prior asked near the contact alone: what it costs no mesh makes larger.

`ModalNewton.step` takes the prior's answer at all unknowns. Where only cells near the contact count
(`mixpinn.reduced.near_cells`), it is needed at their nodes, and residual and modes meet there. What the clusters of a
compliance and the dual modes have at a node is kept together here, so that a few thousand nodes are read in turn.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from mixpinn.base.arrays import AnyArray, Float32Array, FloatArray, IntArray
from mixpinn.geometry.rotations import rotation_from_vector
from mixpinn.reduced.compliance.clusters import Cluster, ClusteredCompliance
from mixpinn.reduced.compliance.row_products import combine_rows, rows_times
from mixpinn.reduced.compliance.rows import Rows
from mixpinn.reduced.modal_newton import ModalNewton
from mixpinn.reduced.prior import ContactSystem


class NearAnswer:
    """Newton steps from the prior's answers to forces on contact nodes; threads may share one."""

    def __init__(self, newton: ModalNewton) -> None:
        """Lay out what is asked near contacts.

        Args:
            newton: with `near` cells, on a prior in clusters.
        """
        prior, compliance = newton.prior, newton.prior.compliance
        assert newton.near is not None
        assert isinstance(compliance, ClusteredCompliance)
        space = prior.coordinates
        self.newton, self._near, self._compliance = newton, newton.near, compliance
        within = space.free[compliance.inside[::3] // 3]
        self._free, self._inside, self._probed = (
            _numbers(nodes, space.n_nodes) for nodes in (space.free, within, prior.nodes)
        )
        self._part: IntArray = np.full(space.n_nodes, -1)
        self._arms = np.zeros((space.n_nodes, 3))
        for number, (nodes, arms) in enumerate(zip(space.parts, space.arms, strict=True)):
            self._part[nodes], self._arms[nodes] = number, arms
        self._clusters = [_ByNode.of(cluster, len(within)) for cluster in compliance.clusters]
        duals = newton.duals
        self._duals = _by_node(duals.numbers[:, : space.n_soft])
        self._dual_scale = _scale_of(duals)
        self._twist_duals = np.ascontiguousarray(duals.columns(np.arange(space.n_soft, space.size)).dense())

    def step(self, contact: ContactSystem, force: FloatArray) -> Float32Array:
        """ν (m,) from the prior's answer to forces (3 l,) [N] on contact nodes; as `ModalNewton.step` of it."""
        near, space, rows = self._near, self.newton.prior.coordinates, contact.rows
        factors = force.astype(np.float32)
        blocks, weights = near.around(rows)
        nodes = near.nodes_of(blocks, space.n_nodes)
        clusters = [
            (self._clusters[number].beside(self._inside[nodes], nodes), factors[chosen], chosen, local)
            for number, chosen, local in self._compliance.of_rows(rows)
        ]
        probed, exact = self._probed[nodes], self._compliance.exact
        on_skin, probed = nodes[probed >= 0], probed[probed >= 0]

        # Only the rows of `nodes` are ever written or read, of this and of the forces.
        field = np.empty((space.n_nodes, 3), dtype=np.float32)
        own = np.zeros(exact.shape[1], dtype=np.float32)
        combine_rows(exact, rows, factors, own)
        twists = own[len(exact) :].astype(np.float64).reshape(-1, 6)
        turns = rotation_from_vector(twists[:, 3:])
        _place(nodes, self._part, self._arms, twists, turns, field)
        field[on_skin] = own[: len(exact)].reshape(-1, 3)[probed]
        for cluster, factor, _, local in clusters:
            cluster.add_to(field, factor, local)
        nodal = np.empty_like(field)
        nodal[nodes] = 0.0
        near.add_forces(field, blocks, weights, nodal)
        wrench = near.wrenches(twists)
        _add_wrenches(nodes, self._part, self._arms, turns, nodal, wrench)
        wrench[space.held] = 0.0
        nodal[self.newton.prior.nodes[rows[::3] // 3]] = 0.0  # held by contact

        own[:] = 0.0
        own[: len(exact)].reshape(-1, 3)[probed] = nodal[on_skin]
        own[len(exact) :] = wrench.ravel()
        moved = np.empty(len(rows), dtype=np.float32)
        rows_times(exact, rows, own, moved)
        for cluster, _, chosen, local in clusters:
            moved[chosen] += cluster.times(nodal, local)
        held = contact.solve(moved).astype(np.float32)
        step = np.zeros(len(self._dual_scale), dtype=np.float32)
        _add_products(self._duals, self._free[nodes], nodes, nodal, step)
        step = self._dual_scale * step + self._twist_duals @ own[len(exact) :]
        return self.newton.coupling[:, rows] @ held - step


@dataclass(frozen=True, eq=False)
class _ByNode:
    """A cluster with what its far modes have at a node side by side.

    Attributes:
        cluster: see `Cluster`.
        place: of each node inside among those near the cluster, or −1, shape (I / 3,).
        far: numbers of its r modes at each node inside, shape (I / 3, 3, r).
        scale: of each mode, shape (r,).
    """

    cluster: Cluster
    place: IntArray
    far: AnyArray
    scale: Float32Array

    @staticmethod
    def of(cluster: Cluster, inside: int) -> "_ByNode":
        """Of a cluster, with so many nodes inside the body."""
        place = _numbers(cluster.close[::3] // 3, inside)
        return _ByNode(cluster, place, _by_node(cluster.far.numbers), _scale_of(cluster.far))

    def beside(self, inside: IntArray, nodes: IntArray) -> "_Beside":
        """At some nodes of the mesh (k,), which have these numbers inside, or −1."""
        soft = inside >= 0
        inside, nodes = inside[soft], nodes[soft]
        place = self.place[inside]
        near = place >= 0
        return _Beside(self, place[near], nodes[near], inside[~near], nodes[~near])


@dataclass(frozen=True, eq=False)
class _Beside:
    """A cluster at some nodes of the mesh: those near it, by their places there, and the others, by their numbers."""

    whole: _ByNode
    place: IntArray
    near: IntArray
    number: IntArray
    far: IntArray

    def add_to(self, field: Float32Array, factors: Float32Array, local: IntArray) -> None:
        """As `Cluster.add_to` for displacements (n, 3) of these nodes."""
        cluster = self.whole.cluster
        moved = np.zeros(len(cluster.close), dtype=np.float32)
        cluster.near.add_to(moved, factors, local)
        _scatter(moved.reshape(-1, 3), self.place, self.near, field)
        if len(self.whole.scale):
            _add_far(self.whole.far, self.whole.scale * (factors @ cluster.left[local]), self.number, self.far, field)

    def times(self, nodal: Float32Array, local: IntArray) -> Float32Array:
        """As `Cluster.times` for forces (n, 3) on these nodes alone."""
        cluster = self.whole.cluster
        beside = np.zeros((len(cluster.close) // 3, 3), dtype=np.float32)
        beside[self.place] = nodal[self.near]
        found = cluster.near.times(beside.ravel(), local)
        if not len(self.whole.scale):
            return found
        amounts = np.zeros(len(self.whole.scale), dtype=np.float32)
        _add_products(self.whole.far, self.number, self.far, nodal, amounts)
        return found + cluster.left[local] @ (self.whole.scale * amounts)


def _numbers(nodes: IntArray, count: int) -> IntArray:
    """The number of each of `count` nodes among `nodes`, or −1."""
    found = np.full(count, -1)
    found[nodes] = np.arange(len(nodes))
    return found


def _by_node(rows: AnyArray) -> AnyArray:
    """Rows (r, 3 s) node by node, shape (s, 3, r)."""
    return np.ascontiguousarray(rows.reshape(len(rows), -1, 3).transpose(1, 2, 0))


def _scale_of(rows: Rows) -> Float32Array:
    """By which each row's numbers are multiplied, shape (r,)."""
    return np.ones(len(rows), dtype=np.float32) if rows.scale is None else rows.scale


# mypy cannot see through numba's decorators: the kernels are untyped, their callers are not.


@njit(cache=True, nogil=True)
def _place(nodes, part, arms, twists, turns, field):  # type: ignore[no-untyped-def]
    """t + (R − 1) a at nodes of rigid parts, zero at others.

    As `ReducedCoordinates` has it, and the wrenches below, but at these nodes alone. With its kernels, over all nodes
    of parts, an answer on a mesh of 105,000 nodes takes a tenth of a millisecond longer, about 4 %.
    """
    for k in range(len(nodes)):
        node = nodes[k]
        row, number = field[node], part[node]
        if number < 0:
            row[0] = row[1] = row[2] = 0.0
            continue
        turn, arm = turns[number], arms[node]
        for i in range(3):
            row[i] = twists[number, i] - arm[i] + turn[i, 0] * arm[0] + turn[i, 1] * arm[1] + turn[i, 2] * arm[2]


@njit(cache=True, nogil=True)
def _add_wrenches(nodes, part, arms, turns, nodal, out):  # type: ignore[no-untyped-def]
    """Net force and moment Σ R a × f about the centroid of each part, added to `out` (K, 6)."""
    arm = np.empty(3)
    for k in range(len(nodes)):
        node = nodes[k]
        number = part[node]
        if number < 0:
            continue
        turn, rest, force, wrench = turns[number], arms[node], nodal[node], out[number]
        for i in range(3):
            arm[i] = turn[i, 0] * rest[0] + turn[i, 1] * rest[1] + turn[i, 2] * rest[2]
            wrench[i] += force[i]
        wrench[3] += arm[1] * force[2] - arm[2] * force[1]
        wrench[4] += arm[2] * force[0] - arm[0] * force[2]
        wrench[5] += arm[0] * force[1] - arm[1] * force[0]


@njit(cache=True, nogil=True)
def _scatter(moved, place, nodes, field):  # type: ignore[no-untyped-def]
    """field[node] += moved[place]."""
    for k in range(len(nodes)):
        row, part = field[nodes[k]], moved[place[k]]
        row[0] += part[0]
        row[1] += part[1]
        row[2] += part[2]


@njit(cache=True, nogil=True, fastmath=True)
def _add_far(far, amounts, numbers, nodes, field):  # type: ignore[no-untyped-def]
    """field[node] += far[number] · amounts."""
    for k in range(len(nodes)):
        at, row = far[numbers[k]], field[nodes[k]]
        x, y, z = at[0], at[1], at[2]
        a = b = c = np.float32(0.0)
        for r in range(len(amounts)):
            a += x[r] * amounts[r]
            b += y[r] * amounts[r]
            c += z[r] * amounts[r]
        row[0] += a
        row[1] += b
        row[2] += c


@njit(cache=True, nogil=True, fastmath=True)
def _add_products(rows, numbers, nodes, nodal, out):  # type: ignore[no-untyped-def]
    """out += Σ rows[number]ᵀ nodal[node] over the nodes that have a number."""
    for k in range(len(nodes)):
        if numbers[k] < 0:
            continue
        at, force = rows[numbers[k]], nodal[nodes[k]]
        x, y, z = at[0], at[1], at[2]
        for r in range(len(out)):
            out[r] += x[r] * force[0] + y[r] * force[1] + z[r] * force[2]
