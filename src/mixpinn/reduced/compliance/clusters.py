"""A compliance in little memory: contact nodes in clusters, each answered exactly near by and in few modes farther off.

The response of the body to forces on neighbouring nodes is nearly the same some distance away. For each cluster of
contact nodes, with rows C_k, the nodes inside the body are near or far:

    C_k ≈ [N_k, U_k V_k],    V_k = U_kᵀ C_k,far,

U_k the leading left singular vectors of C_k,far, so many that the root mean square of what is missed is at most 5e-5
of the largest entries of the rows (six times that of rounding them to 16-bit integers). N_k and V_k are kept in
integers (see `Rows`); displacements of the contact nodes themselves, and twists, stay as they are. Of a patient with
21,000 nodes a third of the memory remains, and products take no longer. It is one level of a hierarchical matrix.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from mixpinn.base.arrays import AnyArray, BoolArray, Float32Array, FloatArray, IntArray
from mixpinn.base.progress import track
from mixpinn.reduced.compliance.row_products import combine_rows, rows_times
from mixpinn.reduced.compliance.rows import Rows

_NEAR = 1.6
"""Nodes within so many radii of a cluster's contact nodes are near it."""
_MISSED = 5e-5
"""Root mean square of what the far part misses, of the largest entries of its rows."""
_WORTH_IT = 0.8
"""More modes than this part of the rows save nothing: all nodes are near then."""


@dataclass(frozen=True, eq=False)
class Cluster:
    """The rows of some contact nodes; ρ rows, I unknowns inside the body, r modes.

    Attributes:
        rows: which they are, ascending, shape (ρ,).
        close: numbers among the unknowns inside of those that are near, ascending, shape (n,).
        near: N_k, shape (ρ, n).
        left: U_k, float32, shape (ρ, r).
        far: V_k, zero at near unknowns, shape (r, I).
    """

    rows: IntArray
    close: IntArray
    near: Rows
    left: Float32Array
    far: Rows

    def add_to(self, out: Float32Array, factors: Float32Array, local: IntArray) -> None:
        """`out` (I,) += Σ_k factors_k row_k over some of the rows, counted here."""
        if len(self.far):
            self.far.add_to(out, factors @ self.left[local])
        part = np.zeros(len(self.close), dtype=np.float32)
        self.near.add_to(part, factors, local)
        out[self.close] += part

    def times(self, inside: Float32Array, local: IntArray) -> Float32Array:
        """row_k · inside of some of the rows, counted here, shape (l,)."""
        found = self.near.times(inside[self.close], local)
        return found + self.left[local] @ self.far.times(inside) if len(self.far) else found

    def columns(self, inside: IntArray) -> "Cluster":
        """For some of the unknowns inside alone, ascending, shape (k,)."""
        _, close, among = np.intersect1d(inside, self.close, return_indices=True)
        return Cluster(self.rows, close, self.near.columns(among), self.left, self.far.columns(inside))

    def dense(self) -> Float32Array:
        """As it is, shape (ρ, I)."""
        matrix = self.left @ self.far.dense()
        matrix[:, self.close] = self.near.dense()
        return matrix


@dataclass(frozen=True, eq=False)
class ClusteredCompliance:
    """C by clusters of its contact nodes; see `mixpinn.reduced.compliance.forms.Compliance`.

    Attributes:
        clusters: that have each row once.
        exact: columns of other unknowns than displacements inside, float32, shape (R, E).
        unknowns: which these are: the contact nodes' own (R,) first.
    """

    clusters: tuple[Cluster, ...]
    exact: Float32Array
    unknowns: IntArray

    def __post_init__(self) -> None:
        owner, place = np.empty((2, len(self.exact)), dtype=np.int64)
        for number, cluster in enumerate(self.clusters):
            owner[cluster.rows], place[cluster.rows] = number, np.arange(len(cluster.rows))
        object.__setattr__(self, "_owner", owner)
        object.__setattr__(self, "_place", place)
        object.__setattr__(self, "_inside", np.setdiff1d(np.arange(self.shape[1]), self.unknowns))

    @staticmethod
    def of(
        matrix: Float32Array, unknowns: IntArray, places: FloatArray, inside: FloatArray, *, most: int = 64,
    ) -> "ClusteredCompliance":
        """Of a whole C, shape (R, D); other arguments as in `of_solves`."""
        return ClusteredCompliance.of_solves(lambda rows: matrix[rows], unknowns, places, inside, most=most)

    @staticmethod
    def of_solves(
        solve: Callable[[IntArray], Float32Array], unknowns: IntArray, places: FloatArray, inside: FloatArray, *,
        most: int = 64,
    ) -> "ClusteredCompliance":
        """Of rows of C that are asked for cluster by cluster: C as a whole need not fit into memory.

        Args:
            solve: rows of C by their numbers (ρ,), shape (ρ, D).
            unknowns: see above.
            places: of the contact nodes [mm], shape (R / 3, 3).
            inside: places of the nodes whose displacements are inside, as their unknowns follow, shape (I / 3, 3).
            most: contact nodes of a cluster.
        """
        columns = np.setdiff1d(np.arange(3 * len(inside) + len(unknowns)), unknowns)
        exact = np.empty((3 * len(places), len(unknowns)), dtype=np.float32)
        clusters = []
        for nodes in track(_parts(places, most), "clusters of contact nodes"):
            rows = rows_of(nodes)
            whole = solve(rows)
            exact[rows] = whole[:, unknowns]
            clusters.append(_cluster(rows, np.ascontiguousarray(whole[:, columns]), _far(places[nodes], inside)))
        return ClusteredCompliance(tuple(clusters), exact, unknowns)

    @property
    def shape(self) -> tuple[int, int]:
        """R and D."""
        return len(self.exact), self.clusters[0].far.numbers.shape[1] + self.exact.shape[1]

    @property
    def inside(self) -> IntArray:
        """The unknowns in clusters, shape (I,)."""
        found: IntArray = self._inside  # type: ignore[attr-defined]
        return found

    def respond(self, rows: IntArray, force: AnyArray) -> Float32Array:
        """As `Compliance.respond`."""
        factors = np.asarray(force, dtype=np.float32).ravel()
        exact, inside = np.zeros(self.exact.shape[1], np.float32), np.zeros(len(self.inside), np.float32)
        combine_rows(self.exact, rows, factors, exact)
        for number, chosen, local in self.of_rows(rows):
            self.clusters[number].add_to(inside, factors[chosen], local)
        out = np.empty(self.shape[1], dtype=np.float32)
        out[self.inside], out[self.unknowns] = inside, exact
        return out

    def read(self, rows: IntArray, residual: Float32Array) -> Float32Array:
        """As `Compliance.read`."""
        out = np.empty(len(rows), np.float32)
        rows_times(self.exact, rows, np.ascontiguousarray(residual[self.unknowns], dtype=np.float32), out)
        inside = np.ascontiguousarray(residual[self.inside], dtype=np.float32)
        for number, chosen, local in self.of_rows(rows):
            out[chosen] += self.clusters[number].times(inside, local)
        return out

    @property
    def arrays(self) -> tuple[AnyArray, ...]:
        """As `Compliance.arrays`."""
        return tuple(rows.numbers for cluster in self.clusters for rows in (cluster.near, cluster.far))

    def own(self, unknowns: IntArray) -> Float32Array:
        """As `Compliance.own`."""
        return self.exact[:, : len(self.exact)]

    def times(self, fields: AnyArray) -> Float32Array:
        """As `Compliance.times`."""
        rows = np.asarray(fields, dtype=np.float32)
        product: Float32Array = rows[:, self.unknowns] @ self.exact.T
        inside = rows[:, self.inside]
        for cluster in self.clusters:
            product[:, cluster.rows] += inside @ cluster.dense().T
        return product

    def dense(self) -> Float32Array:
        """C as it is, shape (R, D)."""
        matrix = np.empty(self.shape, dtype=np.float32)
        matrix[:, self.unknowns] = self.exact
        for cluster in self.clusters:
            matrix[np.ix_(cluster.rows, self.inside)] = cluster.dense()
        return matrix

    def columns(self, chosen: IntArray) -> "ClusteredCompliance":
        """For some unknowns alone (k,), ascending: its D is k, and its inner block is not what `own` says."""
        inside = np.intersect1d(self.inside, chosen, return_indices=True)[1]
        exact, place = np.intersect1d(self.unknowns, chosen, return_indices=True)[1:]
        clusters = tuple(cluster.columns(inside) for cluster in self.clusters)
        return ClusteredCompliance(clusters, np.ascontiguousarray(self.exact[:, exact]), place)

    def of_rows(self, rows: IntArray) -> Iterator[tuple[int, IntArray, IntArray]]:
        """Clusters that have some rows (l,), by number, which of these each has, and the rows' numbers there."""
        owner: IntArray = self._owner[rows]  # type: ignore[attr-defined]
        for number in np.unique(owner):
            chosen = np.flatnonzero(owner == number)
            yield int(number), chosen, self._place[rows[chosen]]  # type: ignore[attr-defined]


def _parts(places: FloatArray, most: int) -> list[IntArray]:
    """Numbers of the nodes of each cluster: halved across their longest extent until they are few."""
    whole: list[IntArray] = [np.arange(len(places))]
    found: list[IntArray] = []
    while whole:
        nodes = whole.pop()
        if len(nodes) <= most:
            found.append(np.sort(nodes))
            continue
        axis = int(np.ptp(places[nodes], axis=0).argmax())
        nodes = nodes[np.argsort(places[nodes, axis], kind="stable")]
        whole += [nodes[: len(nodes) // 2], nodes[len(nodes) // 2:]]
    return found


def _far(cluster: FloatArray, inside: FloatArray) -> BoolArray:
    """Which nodes inside (I / 3, 3) are far from the nodes of a cluster."""
    centre = 0.5 * (cluster.min(axis=0) + cluster.max(axis=0))
    radius = float(np.linalg.norm(cluster - centre, axis=1).max())
    far: BoolArray = cKDTree(cluster).query(inside)[0] > _NEAR * radius
    return far


def _cluster(rows: IntArray, whole: Float32Array, far: BoolArray) -> Cluster:
    """Of some rows: their responses inside (ρ, I), and which nodes inside (I / 3,) are far."""
    distant = np.repeat(far, 3)
    of_far = np.where(distant, whole, np.float32(0.0))
    exact = of_far.astype(np.float64)
    squared, vectors = np.linalg.eigh(exact @ exact.T)
    missed = np.cumsum(np.maximum(squared, 0.0))  # by leaving out the first, the second …
    allowed = (_MISSED * np.abs(whole).max(axis=1, initial=0.0).mean()) ** 2 * len(rows) * max(distant.sum(), 1)
    left = vectors[:, int(np.searchsorted(missed, allowed, side="right")):]
    if left.shape[1] > _WORTH_IT * len(rows):
        left, distant = left[:, :0], np.zeros_like(distant)
    close = np.flatnonzero(~distant)
    return Cluster(
        rows, close, Rows.of(whole[:, close], integers=True), left.astype(np.float32),
        Rows.of((left.T @ exact).astype(np.float32), integers=True),
    )


def rows_of(nodes: IntArray) -> IntArray:
    """The rows of contact nodes by their numbers, three each."""
    found: IntArray = (3 * nodes[:, None] + np.arange(3)).ravel()
    return found
