"""Rows: a matrix that is asked for sums of its rows and for their products, in single precision or 16-bit integers.

Integers take half the memory, and these products take as long as memory needs to hand over the matrix. They are off by
at most half of a row's scale, 1 / 65,534 of its largest entry.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mixpinn.base.arrays import AnyArray, Float32Array, IntArray
from mixpinn.reduced.compliance.row_products import combine_rows, rows_times

_LARGEST = 32_767
"""The largest of the 16-bit integers."""


@dataclass(frozen=True, eq=False)
class Rows:
    """A matrix (m, D) by rows.

    Attributes:
        numbers: float32, or int16, shape (m, D); may lie on disk.
        scale: by which each row of integers is multiplied, float32, shape (m,); None with float32.
    """

    numbers: Float32Array | NDArray[np.int16]
    scale: Float32Array | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "_all", np.arange(len(self.numbers)))

    def __len__(self) -> int:
        return len(self.numbers)

    @staticmethod
    def of(matrix: AnyArray, *, integers: bool = False) -> "Rows":
        """Of a matrix (m, D), in 16-bit integers or as it is."""
        if not integers:
            return Rows(np.ascontiguousarray(matrix, dtype=np.float32))
        numbers, scale = np.empty(matrix.shape, dtype=np.int16), np.empty(len(matrix), dtype=np.float32)
        for row, (packed, values) in enumerate(zip(numbers, matrix, strict=True)):
            scale[row] = max(float(np.abs(values).max(initial=0.0)), 1e-30) / _LARGEST
            packed[:] = np.rint(values / scale[row])
        return Rows(numbers, scale)

    def first(self, count: int) -> "Rows":
        """The first `count` rows."""
        return Rows(self.numbers[:count], None if self.scale is None else self.scale[:count])

    def columns(self, chosen: IntArray) -> "Rows":
        """Some of the columns, as they are kept."""
        kept: Float32Array | NDArray[np.int16] = np.ascontiguousarray(self.numbers[:, chosen])  # type: ignore[assignment]
        return Rows(kept, self.scale)

    def packed(self) -> "Rows":
        """In 16-bit integers."""
        return self if self.scale is not None else Rows.of(self.numbers, integers=True)

    def dense(self) -> Float32Array:
        """As a matrix, float32, shape (m, D)."""
        if self.scale is None:
            return np.asarray(self.numbers, dtype=np.float32)
        return self.numbers.astype(np.float32) * self.scale[:, None]

    def add_to(self, out: Float32Array, factors: Float32Array, rows: IntArray | None = None) -> None:
        """`out` (D,) += Σ_k factors_k row_k, of the rows (l,) or of all."""
        chosen = self._all if rows is None else rows  # type: ignore[attr-defined]
        combine_rows(self.numbers, chosen, factors if self.scale is None else factors * self.scale[chosen], out)

    def times(self, vector: Float32Array, rows: IntArray | None = None) -> Float32Array:
        """row_k · vector of the rows (l,) or of all, float32, shape (l,)."""
        chosen = self._all if rows is None else rows  # type: ignore[attr-defined]
        out = np.empty(len(chosen), dtype=np.float32)
        rows_times(self.numbers, chosen, vector, out)
        return out if self.scale is None else self.scale[chosen] * out
