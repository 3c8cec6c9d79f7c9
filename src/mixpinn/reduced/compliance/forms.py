"""The compliance C = K⁻¹ Sᵀ of a prior: how every unknown answers to forces on the contact nodes, and back.

Dense, it is one row of D numbers for each of 3 c force components: 4 GB for 2,300 contact nodes of 52,000 nodes. The
displacement of the contact nodes themselves needs all of that detail, which their own block W has in 3 c by 3 c
numbers. Farther in, responses are smooth and lie near r modes Ψ, which are zero at the contact nodes:

    C f ≈ Ψᵀ (Lᵀ f), and W f at the contact nodes;    Cᵀ r ≈ L (Ψ r) + W r_c, r_c the forces on the contact nodes,

the second the exact transpose of the first. The modes are orthonormal with weights M that hardly count the contact
nodes, and L = (Ψ M C)ᵀ = (Ψ M K⁻¹ Sᵀ)ᵀ are the coefficients of the responses: a solve for each mode, and no C.

In a bundle it lies in clusters (`mixpinn.reduced.compliance.clusters`).
"""

import mmap
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from mixpinn.base.arrays import AnyArray, Float32Array, IntArray
from mixpinn.reduced.compliance.row_products import combine_rows, rows_times


class Compliance(Protocol):
    """C by its products: R = 3 c rows C_k, each the answer of D unknowns to a unit force. Threads may share one."""

    @property
    def shape(self) -> tuple[int, int]:
        """R and D."""

    def respond(self, rows: IntArray, force: AnyArray) -> Float32Array:
        """Σ_k f_k C_k over the rows (l,): unknowns under forces (l,) [N], float32, shape (D,)."""

    def read(self, rows: IntArray, residual: Float32Array) -> Float32Array:
        """C_k · r of the rows (l,): displacement of these nodes under forces on all unknowns (D,), shape (l,)."""

    @property
    def arrays(self) -> tuple[AnyArray, ...]:
        """What it is made of, which may lie on disk."""

    def own(self, unknowns: IntArray) -> Float32Array:
        """The columns of the contact nodes' own unknowns (R,), shape (R, R)."""

    def times(self, fields: AnyArray) -> Float32Array:
        """Products of rows (k, D) with all rows of C, shape (k, R)."""


@dataclass(frozen=True, eq=False)
class DenseCompliance:
    """C as it is.

    Attributes:
        matrix: [mm/N], float32, shape (R, D); may lie on disk.
    """

    matrix: Float32Array

    @property
    def shape(self) -> tuple[int, int]:
        """R and D."""
        rows, unknowns = self.matrix.shape
        return rows, unknowns

    def respond(self, rows: IntArray, force: AnyArray) -> Float32Array:
        """As `Compliance.respond`."""
        out = np.zeros(self.matrix.shape[1], dtype=np.float32)
        combine_rows(self.matrix, rows, np.asarray(force, dtype=np.float32).ravel(), out)
        return out

    def read(self, rows: IntArray, residual: Float32Array) -> Float32Array:
        """As `Compliance.read`."""
        out = np.empty(len(rows), dtype=np.float32)
        rows_times(self.matrix, rows, residual, out)
        return out

    @property
    def arrays(self) -> tuple[AnyArray, ...]:
        """As `Compliance.arrays`."""
        return (self.matrix,)

    def own(self, unknowns: IntArray) -> Float32Array:
        """As `Compliance.own`."""
        return self.matrix[:, unknowns]

    def times(self, fields: AnyArray) -> Float32Array:
        """As `Compliance.times`."""
        product: Float32Array = np.asarray(fields, dtype=np.float32) @ self.matrix.T
        return product


def read_ahead(compliance: "Compliance") -> None:
    """Read now what lies in a mapped file and is read where an answer first needs it: a byte of each page is enough."""
    for array in compliance.arrays:
        if isinstance(array, np.memmap):
            array.ravel(order="K").view(np.uint8)[:: mmap.PAGESIZE].max(initial=0)


@dataclass(frozen=True, eq=False)
class FactoredCompliance:
    """C by its own block and r modes.

    Attributes:
        left: L, shape (R, r).
        right: Ψ, zero at the contact nodes' unknowns, shape (r, D); may lie on disk.
        block: W [mm/N], float32, symmetric, shape (R, R).
        unknowns: the contact nodes' own, shape (R,).
    """

    left: Float32Array
    right: Float32Array
    block: Float32Array
    unknowns: IntArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "_all", np.arange(len(self.right)))

    @property
    def shape(self) -> tuple[int, int]:
        """R and D."""
        return len(self.left), self.right.shape[1]

    def respond(self, rows: IntArray, force: AnyArray) -> Float32Array:
        """As `Compliance.respond`; its cost does not grow with the number of rows but for the contact nodes."""
        factors = np.asarray(force, dtype=np.float32).ravel()
        amount, skin = np.zeros(len(self.right), np.float32), np.zeros(len(self.block), np.float32)
        combine_rows(self.left, rows, factors, amount)
        combine_rows(self.block, rows, factors, skin)
        out = np.zeros(self.right.shape[1], dtype=np.float32)
        combine_rows(self.right, self._all, amount, out)  # type: ignore[attr-defined]
        out[self.unknowns] = skin
        return out

    def read(self, rows: IntArray, residual: Float32Array) -> Float32Array:
        """As `Compliance.read`."""
        amount, of_skin = np.empty(len(self.right), np.float32), np.empty(len(rows), np.float32)
        rows_times(self.right, self._all, residual, amount)  # type: ignore[attr-defined]
        rows_times(self.block, rows, np.ascontiguousarray(residual[self.unknowns], dtype=np.float32), of_skin)
        out = np.empty(len(rows), np.float32)
        rows_times(self.left, rows, amount, out)
        return out + of_skin

    @property
    def arrays(self) -> tuple[AnyArray, ...]:
        """As `Compliance.arrays`."""
        return self.left, self.right, self.block

    def own(self, unknowns: IntArray) -> Float32Array:
        """As `Compliance.own`."""
        return self.block

    def times(self, fields: AnyArray) -> Float32Array:
        """As `Compliance.times`."""
        rows = np.asarray(fields, dtype=np.float32)
        product: Float32Array = (rows @ self.right.T) @ self.left.T + rows[:, self.unknowns] @ self.block
        return product

    def dense(self) -> DenseCompliance:
        """Multiplied out."""
        matrix = self.left @ self.right
        matrix[:, self.unknowns] = self.block
        return DenseCompliance(matrix)
