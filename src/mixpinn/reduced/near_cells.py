"""The cells near a contact: where nearly all is that the linear answer misses, however many cells a mesh has.

What linear elasticity leaves unbalanced is of second order in the strains, and strains fall off with the square of the
distance from the probe, or faster: of a Newton step of patients some 97 % come from cells within 40 mm of the contact
nodes, a thirtieth of all. So where a mesh has many cells, the forces beyond linear elasticity,

    r = Σ_cells w ∫ (P(F) − P_lin(F)) ∂N/∂X,    P_lin = μ (H + Hᵀ) + λ tr H 1,

are summed over cells within `reach` alone, with weights w that fall from one to zero over the last part of the way.
The linear share is left out cell by cell, because in the prior's answer it is balanced as a whole only; what finite
rotations of rigid parts add to it is lost, on a patient 0.7 % of a step. Joints count as a whole. The cells lie in
blocks of neighbours, and blocks are near or not.
"""

import numpy as np
from numba import njit
from scipy.spatial import cKDTree

from mixpinn.base.arrays import AnyArray, Float32Array, FloatArray, IntArray
from mixpinn.geometry.rotations import rotation_from_vector
from mixpinn.physics.single_precision import LANES, add_nonlinear_forces, in_lanes
from mixpinn.records import TissueMesh
from mixpinn.reduced.coordinates import ReducedCoordinates
from mixpinn.reduced.equilibrium import Equilibrium, cell_arrays

_ALL_CELLS = 20_000
"""So many cells, or fewer, are all summed over: all of a patient's mesh at the default size."""
_REACH = 20.0
"""How far from contact nodes cells count where there are more [mm]."""
_FADING = 0.25
"""The last part of the reach, over which weights fall to zero."""


def cells_near(mesh: TissueMesh, equilibrium: Equilibrium, nodes: IntArray) -> "NearCells | None":
    """The cells that Newton steps are summed over on a mesh of many; None: over all.

    Linear cells, foundations and a membrane always count as a whole.
    """
    if mesh.order == 1 or equilibrium.rests_on_skin or int(mesh.deforming_cells.sum()) <= _ALL_CELLS:
        return None
    return NearCells(mesh, equilibrium, nodes, _REACH)


class NearCells:
    """Forces beyond linear elasticity around the contact nodes of a prior."""

    def __init__(self, mesh: TissueMesh, equilibrium: Equilibrium, nodes: IntArray, reach: float) -> None:
        """Find the cells near every contact node.

        Args:
            mesh: of ten-node cells.
            equilibrium: its materials and joints; neither foundations nor a membrane.
            nodes: contact nodes, shape (c,).
            reach: how far from them cells count [mm].
        """
        assert mesh.order == 2
        assert not equilibrium.rests_on_skin
        self.reach = reach
        cells, gradients, constants = cell_arrays(mesh, equilibrium.mu, equilibrium.lam)
        middles = mesh.points[cells[:, :4]].mean(axis=1)
        order = _neighbours_together(middles)
        self._cells, self._gradients, self._constants = (
            in_lanes(values[order]) for values in (cells, gradients, constants)
        )
        self._joints, self._joint_rest = equilibrium.joints, equilibrium.joints_at_rest()
        centres, radii = _spheres(middles[order])
        places = mesh.node_points[nodes]
        pairs = cKDTree(places).sparse_distance_matrix(
            cKDTree(centres), reach + float(radii.max(initial=0.0)), output_type="coo_matrix",
        )
        away = np.maximum(pairs.data - radii[pairs.col], 0.0)
        weight = np.clip((reach - away) / (_FADING * reach), 0.0, 1.0).astype(np.float32)
        kept = weight > 0.0
        by_node = np.argsort(pairs.row[kept], kind="stable")
        self._blocks = pairs.col[kept][by_node].astype(np.int32)
        self._weights = weight[kept][by_node]
        self._starts = np.searchsorted(pairs.row[kept][by_node], np.arange(len(nodes) + 1))

    def around(self, rows: IntArray) -> tuple[IntArray, Float32Array]:
        """Blocks near contact nodes, by the nodes' rows in the compliance (3 l,), and their weights, both (b,)."""
        weights = np.zeros(len(self._cells), dtype=np.float32)
        _mark(rows[::3] // 3, self._starts, self._blocks, self._weights, weights)
        blocks = np.flatnonzero(weights)
        return blocks, weights[blocks]

    def nodes_of(self, blocks: IntArray, n_nodes: int) -> IntArray:
        """The nodes of the cells in some blocks, of a mesh of so many, ascending."""
        seen = np.zeros(n_nodes, dtype=np.bool_)
        _mark_nodes(blocks, self._cells, seen)
        return np.flatnonzero(seen)

    def forces(self, field: Float32Array, blocks: IntArray, weights: Float32Array) -> Float32Array:
        """Nodal forces [N], float32, shape (n, 3), of some blocks for a displacement field [mm], shape (n, 3)."""
        nodal = np.zeros_like(field)
        self.add_forces(field, blocks, weights, nodal)
        return nodal

    def add_forces(self, field: Float32Array, blocks: IntArray, weights: Float32Array, nodal: Float32Array) -> None:
        """Add `forces` to `nodal` (n, 3); other nodes than those of the blocks are neither read nor written."""
        add_nonlinear_forces(blocks, weights, self._cells, field, self._gradients, self._constants, nodal)

    def wrenches(self, twists: FloatArray) -> FloatArray:
        """What joints add beyond their stiffness at rest [N, N mm] for twists (K, 6), shape (K, 6)."""
        if not len(self._joints):
            return np.zeros_like(twists)
        at_rest, stiffness = self._joint_rest
        now = self._joints.gradient(rotation_from_vector(twists[:, 3:]), twists[:, :3])
        beyond: FloatArray = now - at_rest - (stiffness @ twists.ravel()).reshape(-1, 6)
        return beyond

    def residual(self, unknowns: AnyArray, coordinates: ReducedCoordinates, rows: IntArray) -> Float32Array:
        """As `Equilibrium.residual` [N, N mm], beyond linear elasticity and near contact nodes, shape (D,).

        Args:
            unknowns: the state [mm, rad], shape (D,).
            coordinates: the unknowns.
            rows: of the contact nodes in the compliance, shape (3 l,).
        """
        field = coordinates.expand(unknowns)
        out = coordinates.gather(self.forces(field, *self.around(rows)), field)
        twists = coordinates.twists(unknowns)
        out[coordinates.n_soft:] += self.wrenches(twists).ravel().astype(np.float32)
        if coordinates.held.any():
            out[coordinates.n_soft:].reshape(-1, 6)[coordinates.held] = 0.0
        return out


def _neighbours_together(places: FloatArray) -> IntArray:
    """An order of places (m, 3) in which each `LANES` of them lie together: halved across the longest extent."""
    whole: list[IntArray] = [np.arange(len(places))]
    found: list[IntArray] = []
    while whole:
        some = whole.pop()
        if len(some) <= LANES:
            found.append(some)
            continue
        axis = int(np.ptp(places[some], axis=0).argmax())
        some = some[np.argsort(places[some, axis], kind="stable")]
        half = LANES * max(1, round(len(some) / (2 * LANES)))
        whole += [some[half:], some[:half]]
    return np.concatenate(found) if found else np.empty(0, dtype=np.int64)


def _spheres(places: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Centres (b, 3) and radii (b,) of spheres around each `LANES` of places (m, 3) [mm]."""
    starts = np.arange(0, len(places), LANES)
    centres = np.array([0.5 * (part.min(axis=0) + part.max(axis=0)) for part in np.split(places, starts[1:])])
    of = np.arange(len(places)) // LANES
    return centres, np.sqrt(np.maximum.reduceat(((places - centres[of]) ** 2).sum(axis=1), starts))


# mypy cannot see through numba's decorators: the kernels are untyped, their callers are not.


@njit(cache=True, nogil=True)
def _mark(nodes, starts, blocks, weights, out):  # type: ignore[no-untyped-def]
    """The largest weight of each block near one of the nodes into `out`."""
    for k in range(len(nodes)):
        for at in range(starts[nodes[k]], starts[nodes[k] + 1]):
            out[blocks[at]] = max(out[blocks[at]], weights[at])


@njit(cache=True, nogil=True)
def _mark_nodes(blocks, cells, seen):  # type: ignore[no-untyped-def]
    """`seen` becomes true for each node of the blocks."""
    for k in range(len(blocks)):
        nodes = cells[blocks[k]]
        for i in range(len(nodes)):
            seen[nodes[i]] = True
