"""Compiled assembly: sums of the cells' contributions at nodes and node pairs, and their reduction to the unknowns.

Sums are gathered (each node or pair adds up its own cells, in a fixed order), never scattered: ranges ``start:stop``
may run in threads and give the same bits. See `mixpinn.fem.elements.pattern` for the maps.
"""

import numpy as np

from mixpinn.base.arrays import AnyArray, BoolArray, FloatArray, Int32Array, IntArray
from mixpinn.physics.energies import compiled


@compiled
def gather_forces(
    start: int, stop: int, offsets: IntArray, entries: IntArray, cell_forces: FloatArray, out: FloatArray,
) -> None:
    """Sum cell forces (v m, 3) of cells with v nodes at each node into `out` (n, 3) [N]."""
    for i in range(start, stop):
        f0 = f1 = f2 = 0.0
        for entry in range(offsets[i], offsets[i + 1]):
            e = entries[entry]
            f0 += cell_forces[e, 0]
            f1 += cell_forces[e, 1]
            f2 += cell_forces[e, 2]
        out[i, 0], out[i, 1], out[i, 2] = f0, f1, f2


@compiled
def gather_blocks(
    start: int, stop: int, offsets: IntArray, entries: IntArray, cell_blocks: FloatArray, out: FloatArray,
) -> None:
    """Sum cell blocks (l m, 9) of cells with l pairs of nodes for each pair into `out` (p, 9) [N/mm]."""
    for q in range(start, stop):
        for c in range(9):
            out[q, c] = 0.0
        for entry in range(offsets[q], offsets[q + 1]):
            e = entries[entry]
            for c in range(9):
                out[q, c] += cell_blocks[e, c]


@compiled
def sum_diagonals(
    start: int, stop: int, offsets: IntArray, nodes: IntArray, ids: IntArray, blocks: FloatArray, out: FloatArray,
) -> None:
    """Diagonal blocks K_ii = −Σ_j K_ij into `out` (n, 3, 3) from pair blocks (p, 3, 3), which hold i < j."""
    for i in range(start, stop):
        for r in range(3):
            for c in range(3):
                out[i, r, c] = 0.0
        for entry in range(offsets[i], offsets[i + 1]):
            block = blocks[ids[entry]]
            if i < nodes[entry]:
                for r in range(3):
                    for c in range(3):
                        out[i, r, c] -= block[r, c]
            else:
                for r in range(3):
                    for c in range(3):
                        out[i, r, c] -= block[c, r]
        for r in range(3):  # symmetric by theory; rounding must not decide which triangle is read
            for c in range(r):
                out[i, r, c] = out[i, c, r] = 0.5 * (out[i, r, c] + out[i, c, r])


@compiled
def add_blocks(
    first: IntArray, second: IntArray, ids: IntArray, values: FloatArray, blocks: FloatArray, diagonals: FloatArray,
) -> None:
    """Add external blocks (b, 3, 3) of the pairs (first, second) to the pair blocks and diagonal blocks."""
    for k in range(len(first)):
        i, j = first[k], second[k]
        for r in range(3):
            for c in range(3):
                if i == j:
                    diagonals[i, r, c] += 0.5 * (values[k, r, c] + values[k, c, r])
                elif i < j:
                    blocks[ids[k], r, c] += values[k, r, c]
                else:
                    blocks[ids[k], c, r] += values[k, r, c]


@compiled
def fill_soft_rows(
    start: int, stop: int, soft_nodes: IntArray, part: AnyArray, arms: FloatArray, offsets: IntArray, nodes: IntArray,
    ids: IntArray, entry_offset: IntArray, blocks: FloatArray, diagonals: FloatArray, indptr: Int32Array,
    out: FloatArray,
) -> None:
    """Rows of the free soft nodes start:stop into the CSR values `out` (nnz,).

    A rigid neighbour moves as δx = δt + δw × d = [1, −[d]] (δt, δw), with d its arm (n, 3) from the current centroid;
    hence its block K contributes [K, −K [d]] to the block of its part.
    """
    for s in range(start, stop):
        i = soft_nodes[s]
        for r in range(3):
            row = indptr[3 * s + r]
            for c in range(row, indptr[3 * s + r + 1]):
                out[c] = 0.0
            for c in range(r, 3):
                out[row + c - r] = diagonals[i, r, c]
        for entry in range(offsets[i], offsets[i + 1]):
            offset = entry_offset[entry]
            if offset < 0:
                continue
            j = nodes[entry]
            block = blocks[ids[entry]]
            for r in range(3):
                position = indptr[3 * s + r] + 3 - r + offset
                if i < j:
                    k0, k1, k2 = block[r, 0], block[r, 1], block[r, 2]
                else:
                    k0, k1, k2 = block[0, r], block[1, r], block[2, r]
                out[position] += k0
                out[position + 1] += k1
                out[position + 2] += k2
                if part[j] > 0:  # −(k [d]) = −(k × d) for the row vector k
                    d0, d1, d2 = arms[j, 0], arms[j, 1], arms[j, 2]
                    out[position + 3] += d1 * k2 - d2 * k1
                    out[position + 4] += d2 * k0 - d0 * k2
                    out[position + 5] += d0 * k1 - d1 * k0


@compiled
def reduce_rigid(
    rigid_nodes: IntArray, part: AnyArray, arms: FloatArray, offsets: IntArray, nodes: IntArray, ids: IntArray,
    blocks: FloatArray, diagonals: FloatArray, out: FloatArray,
) -> None:
    """Add Σ J_rᵀ K_rs J_s over rigid nodes r, s to the dense block `out` (6K, 6K), J_r = [1, −[d_r]]."""
    n_parts = len(out) // 6
    carried = np.zeros((n_parts, 3, 6))  # Σ_s K_rs J_s for the current r, by part of s
    touched = np.zeros(n_parts, dtype=np.bool_)
    for index in range(len(rigid_nodes)):
        i = rigid_nodes[index]
        own = part[i] - 1
        touched[:] = False
        touched[own] = True
        carried[own] = 0.0
        _carry(diagonals[i], False, arms[i], carried[own])
        for entry in range(offsets[i], offsets[i + 1]):
            j = nodes[entry]
            if part[j] > 0:
                other = part[j] - 1
                if not touched[other]:
                    touched[other] = True
                    carried[other] = 0.0
                _carry(blocks[ids[entry]], j < i, arms[j], carried[other])
        d0, d1, d2 = arms[i, 0], arms[i, 1], arms[i, 2]
        for other in range(n_parts):
            if touched[other]:
                for c in range(6):
                    k0, k1, k2 = carried[other, 0, c], carried[other, 1, c], carried[other, 2, c]
                    row, column = 6 * own, 6 * other + c
                    out[row, column] += k0
                    out[row + 1, column] += k1
                    out[row + 2, column] += k2
                    out[row + 3, column] += d1 * k2 - d2 * k1  # (−[d])ᵀ k = d × k
                    out[row + 4, column] += d2 * k0 - d0 * k2
                    out[row + 5, column] += d0 * k1 - d1 * k0


@compiled
def _carry(block: FloatArray, transposed: bool, arm: FloatArray, out: FloatArray) -> None:
    d0, d1, d2 = arm[0], arm[1], arm[2]
    for r in range(3):
        if transposed:
            k0, k1, k2 = block[0, r], block[1, r], block[2, r]
        else:
            k0, k1, k2 = block[r, 0], block[r, 1], block[r, 2]
        out[r, 0] += k0
        out[r, 1] += k1
        out[r, 2] += k2
        out[r, 3] += d1 * k2 - d2 * k1
        out[r, 4] += d2 * k0 - d0 * k2
        out[r, 5] += d0 * k1 - d1 * k0


@compiled
def hold_rows(
    start: int, stop: int, held: BoolArray, indptr: Int32Array, indices: Int32Array, data: FloatArray,
) -> None:
    """Zero rows and columns of the held unknowns in upper-triangular CSR values, in place; their diagonal becomes 1."""
    for row in range(start, stop):
        if held[row]:
            data[indptr[row]] = 1.0
            for entry in range(indptr[row] + 1, indptr[row + 1]):
                data[entry] = 0.0
        else:
            for entry in range(indptr[row] + 1, indptr[row + 1]):
                if held[indices[entry]]:
                    data[entry] = 0.0
