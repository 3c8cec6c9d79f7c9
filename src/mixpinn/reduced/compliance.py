"""The compliance C = K⁻¹ Sᵀ of a prior: how every unknown answers to forces on the contact nodes, and back.

Dense, it is one row of D numbers for each of 3 c force components: 4 GB for 2,300 contact nodes of 52,000 nodes. The
displacement of the contact nodes themselves needs all of that detail, which their own block W has in 3 c by 3 c
numbers. Farther in, responses are smooth and lie near r modes Ψ, which are zero at the contact nodes:

    C f ≈ Ψᵀ (Lᵀ f), and W f at the contact nodes;    Cᵀ r ≈ L (Ψ r) + W r_c, r_c the forces on the contact nodes,

the second the exact transpose of the first. The modes are orthonormal with weights M that hardly count the contact
nodes, and L = (Ψ M C)ᵀ = (Ψ M K⁻¹ Sᵀ)ᵀ are the coefficients of the responses: a solve for each mode, and no C.

Packed, it is dense, but displacements of nodes inside, which are most of it, are kept in 16-bit integers, each row with
a scale: half the memory, and half the time to read it. That is off by at most half of a row's scale, 1 / 65,534 of the
row's largest entry inside, for each force. Contact nodes and twists of parts stay as they are.
"""

import mmap
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mixpinn.base.arrays import AnyArray, Float32Array, IntArray
from mixpinn.reduced.row_products import combine_rows, rows_times

_LARGEST = 32_767
"""The largest of the 16-bit integers."""
_AT_A_TIME = 256
"""Rows of a packed compliance that are unpacked at a time for products with all of them."""


class Compliance(Protocol):
    """C by its products: R = 3 c rows C_k, each the answer of D unknowns to a unit force. Threads may share one."""

    @property
    def shape(self) -> tuple[int, int]:
        """R and D."""

    def respond(self, rows: IntArray, force: AnyArray) -> Float32Array:
        """Σ_k f_k C_k over the rows (l,): unknowns under forces (l,) [N], float32, shape (D,)."""

    def read(self, rows: IntArray, residual: Float32Array) -> Float32Array:
        """C_k · r of the rows (l,): displacement of these nodes under forces on all unknowns (D,), shape (l,)."""

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

    def own(self, unknowns: IntArray) -> Float32Array:
        """As `Compliance.own`."""
        return self.matrix[:, unknowns]

    def times(self, fields: AnyArray) -> Float32Array:
        """As `Compliance.times`."""
        product: Float32Array = np.asarray(fields, dtype=np.float32) @ self.matrix.T
        return product

    def packed(self, unknowns: IntArray) -> "PackedCompliance":
        """In 16-bit integers but for some unknowns (E,): the contact nodes' own (R,), then others of another unit."""
        inside = np.setdiff1d(np.arange(self.matrix.shape[1]), unknowns)
        numbers = np.empty((len(self.matrix), len(inside)), dtype=np.int16)
        scale = np.empty(len(self.matrix), dtype=np.float32)
        for row, packed, source in zip(range(len(scale)), numbers, self.matrix, strict=True):
            values = source[inside]
            scale[row] = max(float(np.abs(values).max(initial=0.0)), 1e-30) / _LARGEST
            packed[:] = np.rint(values / scale[row])
        return PackedCompliance(numbers, scale, np.ascontiguousarray(self.matrix[:, unknowns]), unknowns)


def read_ahead(compliance: "Compliance") -> None:
    """Read now what lies in a mapped file and is read where an answer first needs it: a byte of each page is enough."""
    for array in vars(compliance).values():
        if isinstance(array, np.memmap):
            array.ravel(order="K").view(np.uint8)[:: mmap.PAGESIZE].max(initial=0)


@dataclass(frozen=True, eq=False)
class PackedCompliance:
    """C in 16-bit integers but for the contact nodes' own block and for twists.

    Attributes:
        numbers: of displacements inside, in ascending order of the unknowns, int16, shape (R, D − E); may lie on disk.
        scale: by which each row of them is multiplied [mm/N], float32, shape (R,).
        exact: columns of other unknowns, float32, shape (R, E).
        unknowns: which these are: the contact nodes' own (R,) first.
    """

    numbers: NDArray[np.int16]
    scale: Float32Array
    exact: Float32Array
    unknowns: IntArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "_inside", np.setdiff1d(np.arange(self.shape[1]), self.unknowns))

    @property
    def shape(self) -> tuple[int, int]:
        """R and D."""
        return len(self.scale), self.numbers.shape[1] + self.exact.shape[1]

    @property
    def inside(self) -> IntArray:
        """The unknowns in integers, shape (D − E,)."""
        found: IntArray = self._inside  # type: ignore[attr-defined]
        return found

    def respond(self, rows: IntArray, force: AnyArray) -> Float32Array:
        """As `Compliance.respond`."""
        factors = np.asarray(force, dtype=np.float32).ravel()
        exact, inside = np.zeros(self.exact.shape[1], np.float32), np.zeros(self.numbers.shape[1], np.float32)
        combine_rows(self.exact, rows, factors, exact)
        combine_rows(self.numbers, rows, factors * self.scale[rows], inside)
        out = np.empty(self.shape[1], dtype=np.float32)
        out[self.inside], out[self.unknowns] = inside, exact
        return out

    def read(self, rows: IntArray, residual: Float32Array) -> Float32Array:
        """As `Compliance.read`."""
        exact, inside = np.empty(len(rows), np.float32), np.empty(len(rows), np.float32)
        rows_times(self.exact, rows, np.ascontiguousarray(residual[self.unknowns], dtype=np.float32), exact)
        rows_times(self.numbers, rows, np.ascontiguousarray(residual[self.inside], dtype=np.float32), inside)
        return exact + self.scale[rows] * inside

    def own(self, unknowns: IntArray) -> Float32Array:
        """As `Compliance.own`."""
        return self.exact[:, : len(self.scale)]

    def times(self, fields: AnyArray) -> Float32Array:
        """As `Compliance.times`."""
        rows = np.asarray(fields, dtype=np.float32)
        product: Float32Array = rows[:, self.unknowns] @ self.exact.T
        inside = rows[:, self.inside]
        for start in range(0, len(self.scale), _AT_A_TIME):
            part = slice(start, start + _AT_A_TIME)
            product[:, part] += inside @ self.numbers[part].astype(np.float32).T * self.scale[part]
        return product

    def dense(self) -> DenseCompliance:
        """As it is."""
        matrix = np.empty(self.shape, dtype=np.float32)
        matrix[:, self.unknowns] = self.exact
        for row, numbers, scale in zip(matrix, self.numbers, self.scale, strict=True):
            row[self.inside] = scale * numbers
        return DenseCompliance(matrix)


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
