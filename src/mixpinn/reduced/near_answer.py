"""The Newton step behind an answer, with the prior asked near the contact alone: what it costs no mesh makes larger.

`ModalNewton.step` takes the prior's answer at all unknowns. Where only cells near the contact count
(`mixpinn.reduced.near_cells`), it is needed at their nodes, and residual and modes meet there. What the clusters of a
compliance and the dual modes have at a node is kept together here, so that a few thousand nodes are read in turn.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from mixpinn.base.arrays import AnyArray, Float32Array, FloatArray, IntArray
from mixpinn.reduced.clustered_compliance import Cluster, ClusteredCompliance
from mixpinn.reduced.modal_newton import ModalNewton
from mixpinn.reduced.prior import ContactSystem
from mixpinn.reduced.row_products import combine_rows, rows_times


class NearAnswer:
    """Newton steps from the prior's answers to forces on contact nodes; threads may share one."""

    def __init__(self, newton: ModalNewton) -> None:
        """Lay out what is asked near contacts.

        Args:
            newton: with `near` cells, on a prior in clusters.
        """
        compliance = newton.prior.compliance
        assert newton.near is not None
        assert isinstance(compliance, ClusteredCompliance)
        self.newton, self._near, self._compliance = newton, newton.near, compliance
        space = newton.prior.coordinates
        self._free: IntArray = np.full(space.n_nodes, -1)
        self._free[space.free] = np.arange(len(space.free))
        within = space.free[compliance.inside[::3] // 3]
        self._inside: IntArray = np.full(space.n_nodes, -1)
        self._inside[within] = np.arange(len(within))
        self._clusters = [_ByNode.of(cluster, within) for cluster in compliance.clusters]
        duals, self._modes = newton.duals.dense(), len(newton.duals)
        soft = duals[:, : space.n_soft].reshape(self._modes, -1, 3)
        self._duals = np.ascontiguousarray(soft.transpose(1, 2, 0))
        self._of_twists = np.ascontiguousarray(duals[:, space.n_soft :])

    def step(self, contact: ContactSystem, force: FloatArray) -> Float32Array:
        """ν (m,) from the prior's answer to forces (3 l,) [N] on contact nodes; as `ModalNewton.step` of it."""
        space, near, compliance = self.newton.prior.coordinates, self._near, self._compliance
        rows, factors = contact.rows, force.astype(np.float32)
        blocks, weights = near.around(rows)
        nodes = near.nodes_of(blocks, space.n_nodes)
        clusters = [(self._clusters[number], chosen, local) for number, chosen, local in compliance.of_rows(rows)]

        exact = np.zeros(compliance.exact.shape[1], dtype=np.float32)
        combine_rows(compliance.exact, rows, factors, exact)
        count, probed = compliance.shape[0], self.newton.prior.nodes
        field = np.zeros((space.n_nodes, 3), dtype=np.float32)
        field[probed] = exact[:count].reshape(-1, 3)
        inside = self._inside[nodes]
        for cluster, chosen, local in clusters:
            cluster.add_to(field, factors[chosen], local, nodes, inside)
        twists = exact[count:].astype(np.float64).reshape(-1, 6)
        space.place_twists(twists, field)

        nodal = near.forces(field, blocks, weights)
        wrench = space.wrenches(nodal, field) + near.wrenches(twists).astype(np.float32)
        wrench[space.held] = 0.0
        nodal[probed[rows[::3] // 3]] = 0.0  # held by contact

        moved = np.empty(len(rows), dtype=np.float32)
        rows_times(compliance.exact, rows, np.concatenate([nodal[probed].ravel(), wrench.ravel()]), moved)
        for cluster, chosen, local in clusters:
            moved[chosen] += cluster.times(nodal, local, nodes, inside)
        held = contact.solve(moved).astype(np.float32)
        step = np.zeros(self._modes, dtype=np.float32)
        _add_duals(self._duals, self._free[nodes], nodes, nodal, step)
        return self.newton.coupling[:, rows] @ held - step - self._of_twists @ wrench.ravel()


@dataclass(frozen=True, eq=False)
class _ByNode:
    """A cluster with what its far modes have at a node side by side.

    Attributes:
        cluster: see `Cluster`.
        close: the nodes near it.
        far: its modes' numbers at each node inside, shape (I / 3, 3, r).
        scale: of each mode, shape (r,).
    """

    cluster: Cluster
    close: IntArray
    far: AnyArray
    scale: Float32Array

    @staticmethod
    def of(cluster: Cluster, within: IntArray) -> "_ByNode":
        """Of a cluster, where the nodes inside are these (I / 3,)."""
        numbers = cluster.far.numbers
        scale = np.ones(len(numbers), np.float32) if cluster.far.scale is None else cluster.far.scale
        by_node = np.ascontiguousarray(numbers.reshape(len(numbers), -1, 3).transpose(1, 2, 0))
        return _ByNode(cluster, within[cluster.close[::3] // 3], by_node, scale)

    def add_to(
        self, field: Float32Array, factors: Float32Array, local: IntArray, nodes: IntArray, inside: IntArray,
    ) -> None:
        """As `Cluster.add_to` for displacements of `nodes` (k,), which have these numbers inside, or −1.

        Others are not whole: what is near the cluster is added at all of its nodes.
        """
        near = np.zeros(3 * len(self.close), dtype=np.float32)
        self.cluster.near.add_to(near, factors, local)
        field[self.close] += near.reshape(-1, 3)
        if len(self.scale):
            _add_far(self.far, self.scale * (factors @ self.cluster.left[local]), inside, nodes, field)

    def times(self, nodal: Float32Array, local: IntArray, nodes: IntArray, inside: IntArray) -> Float32Array:
        """As `Cluster.times` for forces (n, 3) that are zero but at `nodes`."""
        found = self.cluster.near.times(nodal[self.close].ravel(), local)
        if not len(self.scale):
            return found
        amounts = np.zeros(len(self.scale), dtype=np.float32)
        _add_duals(self.far, inside, nodes, nodal, amounts)
        return found + self.cluster.left[local] @ (self.scale * amounts)


# mypy cannot see through numba's decorators: the kernels are untyped, their callers are not.


@njit(cache=True, nogil=True, fastmath=True)
def _add_far(far, amounts, inside, nodes, field):  # type: ignore[no-untyped-def]
    """field[node] += far[inside] · amounts at each node that is inside."""
    for k in range(len(nodes)):
        if inside[k] < 0:
            continue
        at, row = far[inside[k]], field[nodes[k]]
        for i in range(3):
            part, total = at[i], np.float32(0.0)
            for r in range(len(amounts)):
                total += part[r] * amounts[r]
            row[i] += total


@njit(cache=True, nogil=True, fastmath=True)
def _add_duals(rows, numbers, nodes, nodal, out):  # type: ignore[no-untyped-def]
    """out += Σ rows[number]ᵀ · nodal[node] over the nodes that have a number."""
    for k in range(len(nodes)):
        if numbers[k] < 0:
            continue
        at, force = rows[numbers[k]], nodal[nodes[k]]
        for i in range(3):
            part, factor = at[i], force[i]
            for r in range(len(out)):
                out[r] += part[r] * factor
