"""The constant sparsity pattern of the reduced stiffness matrix, and the maps that fill it without searching."""

from dataclasses import dataclass

import numpy as np

from mixpinn.base.arrays import AnyArray, BoolArray, Int32Array, IntArray


@dataclass(frozen=True, eq=False)
class NodePairs:
    """Pairs of nodes whose stiffness blocks may differ from zero.

    Attributes:
        codes: n i + j of each pair i < j, ascending, shape (p,).
        offsets, nodes, ids: neighbours of node i are entries offsets[i]:offsets[i + 1] of `nodes`, ascending; `ids`
            is the pair of each entry. Shapes (n + 1,), (2p,), (2p,).
        cell_offsets, cell_entries: the blocks c e + l of the cells, with c pairs each, that make up pair q are entries
            cell_offsets[q]:cell_offsets[q + 1] of `cell_entries`. Shapes (p + 1,), (c m,).
    """

    codes: IntArray
    offsets: IntArray
    nodes: IntArray
    ids: IntArray
    cell_offsets: IntArray
    cell_entries: IntArray

    @staticmethod
    def build(n_points: int, cells: IntArray, pairs: IntArray) -> "NodePairs":
        """Pairs `pairs` (p, 2) in any order and with repetitions; those of `cells` included.

        A cell's nodes are ascending, shape (m, v); its pairs count as (0, 1), (0, 2), …, (1, 2), ….
        """
        lower, upper = np.triu_indices(cells.shape[1], 1)
        own = (n_points * cells[:, lower] + cells[:, upper]).ravel()
        pairs = np.sort(pairs.reshape(-1, 2), axis=1)
        pairs = pairs[pairs[:, 0] < pairs[:, 1]]
        codes = np.union1d(own, n_points * pairs[:, 0] + pairs[:, 1])
        first, second = np.divmod(codes, n_points)
        origin, neighbour = np.concatenate([first, second]), np.concatenate([second, first])
        order = np.lexsort((neighbour, origin))
        cell_offsets, cell_entries = incidence(np.searchsorted(codes, own), len(codes))
        return NodePairs(
            codes, _offsets(origin, n_points), neighbour[order], np.tile(np.arange(len(codes)), 2)[order],
            cell_offsets, cell_entries,
        )

    def find(self, first: IntArray, second: IntArray) -> tuple[IntArray, BoolArray]:
        """Pair of nodes first (b,), second (b,) in either order, and whether it exists; i = j always does."""
        n_points = len(self.offsets) - 1
        codes = n_points * np.minimum(first, second) + np.maximum(first, second)
        ids = np.minimum(np.searchsorted(self.codes, codes), len(self.codes) - 1)
        return ids, (first == second) | (self.codes[ids] == codes)


def incidence(target: IntArray, n_targets: int) -> tuple[IntArray, IntArray]:
    """Offsets (n_targets + 1,) and entries: positions e with target[e] = t are entries offsets[t]:offsets[t + 1]."""
    return _offsets(target, n_targets), np.argsort(target, kind="stable")


def _offsets(target: IntArray, n_targets: int) -> IntArray:
    return np.concatenate([[0], np.cumsum(np.bincount(target, minlength=n_targets))]).astype(np.int64)


@dataclass(frozen=True, eq=False)
class Reduction:
    """Upper triangle of the reduced matrix in CSR form, and where each node pair lies in it.

    Reduced unknowns: three per free soft node in the order of the nodes, then six per rigid part. The row of a soft
    node holds its diagonal block, a block of width 3 per later free soft neighbour, a block of width 6 per rigid part
    that it touches; the rows of the rigid parts are dense.

    Attributes:
        soft_nodes: free soft nodes, shape (s,).
        soft_index: per node its index in `soft_nodes`, −1 where it has none, shape (n,).
        n_parts: number of rigid parts K.
        indptr, indices: of the CSR matrix, shapes (3s + 6K + 1,), (nnz,).
        entry_offset: per entry of `NodePairs.nodes`: column offset of its block behind the diagonal block of the
            row, −1 where the row has none; shape (2p,).
    """

    soft_nodes: IntArray
    soft_index: IntArray
    n_parts: int
    indptr: Int32Array
    indices: Int32Array
    entry_offset: IntArray

    @staticmethod
    def build(pairs: NodePairs, part: AnyArray, fixed: BoolArray, n_parts: int) -> "Reduction":
        """Pattern for nodes labelled `part` (n,), 0 soft or rigid part 1 … K, of which `fixed` (n,) do not move."""
        free = (part == 0) & ~fixed
        soft_nodes = np.flatnonzero(free)
        n_soft = len(soft_nodes)
        soft_index = np.full(len(part), -1, dtype=np.int64)
        soft_index[soft_nodes] = np.arange(n_soft)

        # Blocks (row node, key): key = soft index of a later soft neighbour, or n_soft + k for rigid part k.
        origin = np.repeat(np.arange(len(part)), np.diff(pairs.offsets))
        row = soft_index[origin]
        key = np.where(part[pairs.nodes] > 0, n_soft + part[pairs.nodes].astype(np.int64) - 1, soft_index[pairs.nodes])
        used = (row >= 0) & (key > row)
        stride = n_soft + n_parts
        codes, block = np.unique(row[used] * stride + key[used], return_inverse=True)
        block_row, block_key = np.divmod(codes, stride) if stride else (codes, codes)
        width = np.where(block_key < n_soft, 3, 6)
        row_start = _offsets(block_row, n_soft)
        running = np.concatenate([[0], np.cumsum(width)])
        block_offset = running[:-1] - running[row_start[block_row]]
        entry_offset = np.full(len(pairs.nodes), -1, dtype=np.int64)
        entry_offset[used] = block_offset[block]

        row_width = np.diff(running[row_start])
        lengths = np.concatenate([
            (row_width[:, None] + [3, 2, 1]).ravel(), np.arange(6 * n_parts, 0, -1),
        ])
        indptr = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)
        indices = np.empty(indptr[-1], dtype=np.int32)
        base = np.where(block_key < n_soft, 3 * block_key, 3 * n_soft + 6 * (block_key - n_soft))
        for r in range(3):
            for c in range(r, 3):
                indices[indptr[r:3 * n_soft:3] + (c - r)] = 3 * np.arange(n_soft) + c
            start = indptr[3 * block_row + r] + (3 - r) + block_offset
            for c in range(6):
                wide = width > c
                indices[start[wide] + c] = base[wide] + c
        n_dofs = 3 * n_soft + 6 * n_parts
        for r in range(3 * n_soft, n_dofs):
            indices[indptr[r]:indptr[r + 1]] = np.arange(r, n_dofs)
        return Reduction(soft_nodes, soft_index, n_parts, indptr.astype(np.int32), indices, entry_offset)

    @property
    def n_dofs(self) -> int:
        """Number of reduced unknowns."""
        return 3 * len(self.soft_nodes) + 6 * self.n_parts

    @property
    def nnz(self) -> int:
        """Number of stored entries of the upper triangle."""
        return len(self.indices)
