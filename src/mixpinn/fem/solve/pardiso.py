"""MKL PARDISO for symmetric matrices, called directly: in double or single precision, whole or in two halves."""

import ctypes
import math
import sys
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from mixpinn.base.arrays import FloatArray, IntArray
from mixpinn.base.errors import SolveError
from mixpinn.fem.solve.linear import SINGULAR, compliance_by_solves, symmetric_product

_NOT_POSITIVE = -4
_ANALYSE, _FACTORIZE, _SOLVE, _FORWARD, _BACKWARD, _RELEASE = 11, 22, 33, 331, 333, -1
_POINTER = ctypes.POINTER(ctypes.c_int32)


@cache
def _library() -> Any:
    """MKL where packages for Python put it, else as pypardiso finds it, which takes a second.

    Raises:
        ImportError: no MKL for this platform.
    """
    for pattern in ("lib/libmkl_rt.*", "Library/bin/mkl_rt*.dll"):
        for path in sorted(Path(sys.prefix).glob(pattern)):
            try:
                return ctypes.CDLL(str(path))
            except OSError:
                continue
    import pypardiso

    return pypardiso.PyPardisoSolver().libmkl


@dataclass(eq=False)
class _Handle:
    """One factorization inside PARDISO: matrix type 2 (Cholesky) or −2 (Bunch-Kaufman), and its number type."""

    kind: int
    number: type[np.floating[Any]]
    pointers: FloatArray = field(default_factory=lambda: np.zeros(64, dtype=np.int64))
    options: IntArray = field(default_factory=lambda: np.zeros(64, dtype=np.int32))
    chosen: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int32))
    analysed: bool = False

    def __post_init__(self) -> None:
        self.options[0] = 1  # what follows are no defaults
        self.options[1] = 2  # nested dissection (METIS)
        self.options[7] = 2 if self.kind == -2 else 0  # steps of iterative refinement
        self.options[9] = 8  # pivots below 1e-8 are perturbed
        self.options[20] = 1 if self.kind == -2 else 0  # Bunch-Kaufman
        self.options[27] = int(self.number is np.float32)
        self.options[34] = 1  # indices count from zero


def _aligned(values: FloatArray | float, number: type[np.floating[Any]], shape: tuple[int, ...]) -> FloatArray:
    """`values` in Fortran's order from a multiple of 64 bytes on: MKL's last digits depend on where arrays begin."""
    size = math.prod(shape) * np.dtype(number).itemsize
    memory = np.empty(size + 64, dtype=np.uint8)
    begin = -memory.ctypes.data % 64
    array = memory[begin : begin + size].view(number).reshape(shape, order="F")
    array[...] = values
    return array


class _PardisoError(Exception):
    """PARDISO returned this error code."""

    def __init__(self, value: int) -> None:
        super().__init__(value)
        self.value = value


class PardisoSolver:
    """MKL PARDISO on the upper triangle.

    Cholesky (matrix type 2) as long as the matrices are positive definite, which is several times faster than the
    unsymmetric type 11 that the Python package defaults to; a matrix that turns out indefinite is factorized again
    with Bunch-Kaufman pivoting (type −2), and `indefinite` says so. The symbolic analysis is kept while the pattern
    stays the same, for each of the types.

    The block of the inverse comes from the Schur complement that PARDISO forms on its way when it eliminates the
    unknowns `kept` last: the two together cost what the factorization alone does.

    Args:
        threads: threads of MKL; by default as many as ``OMP_NUM_THREADS`` or the machine says.
        single: factorize in single precision, which halves memory and time. A solve then has an error of about 1e-4,
            enough for an iteration that corrects itself; matrices for which it would be large are factorized in double
            precision all the same.

    Raises:
        ImportError: no MKL for this platform.
    """

    def __init__(self, *, threads: int | None = None, single: bool = False) -> None:
        import pypardiso  # noqa: F401 - absent on platforms without MKL

        self._library = _library()
        self._pardiso = self._library["pardiso"]  # a function of our own, without the argument types of the package
        self._handles: dict[tuple[int, bool], _Handle] = {}
        self._active: _Handle | None = None
        self._pattern: tuple[IntArray, IntArray] | None = None
        self._matrix: sp.csr_matrix | None = None
        self._values: FloatArray = np.empty(0)
        self._kept: IntArray = np.empty(0, dtype=np.int64)
        self.threads, self._single = threads, single
        self.begin()
        self.indefinite = False

    def begin(self) -> None:
        """See `LinearSolver.begin`: single precision is tried, and checked, anew."""
        self._try_single, self._trusted = self._single, False

    @property
    def halves(self) -> bool:
        """Whether `forward` and `backward` can be used with the last factorization."""
        return self._active is not None and self._active.kind == 2

    @property
    def number(self) -> type[np.floating[Any]]:
        """Number type of the last factorization."""
        return np.float64 if self._active is None else self._active.number

    def factorize(self, matrix: sp.csr_matrix) -> None:
        """See `LinearSolver.factorize`."""
        self._factorize_any(matrix, np.empty(0, dtype=np.int64))

    def factorize_with_compliance(
        self, matrix: sp.csr_matrix, kept: IntArray, *, definite: bool = False,
    ) -> FloatArray:
        """See `LinearSolver.factorize_with_compliance`."""
        schur = self._factorize_any(matrix, np.asarray(kept, dtype=np.int64), definite=definite)
        if self.indefinite and definite:
            return schur
        if self.indefinite:
            return compliance_by_solves(self, matrix.shape[0], kept)
        inverse = np.linalg.inv(schur.astype(np.float64))
        symmetric: FloatArray = 0.5 * (inverse + inverse.T)
        return symmetric

    def solve(self, rhs: FloatArray) -> FloatArray:
        """See `LinearSolver.solve`."""
        if self._active is None:
            raise SolveError("no matrix was factorized yet")
        return self._call(self._active, _SOLVE, rhs).astype(np.float64)

    def forward(self, rhs: FloatArray) -> FloatArray:
        """L⁻¹ b (n,) with A = L Lᵀ but for the last block; entries of `kept` are b_k − A_ki A_ii⁻¹ b_i."""
        assert self._active is not None
        return self._call(self._active, _FORWARD, rhs)

    def backward(self, image: FloatArray) -> FloatArray:
        """The solution (n,) from what `forward` gave, with the entries of `kept` replaced by their solution."""
        assert self._active is not None
        return self._call(self._active, _BACKWARD, image)

    def free(self) -> None:
        """Release the memory of the factorizations."""
        for handle in self._handles.values():
            self._release(handle)
        self._matrix = self._pattern = self._active = None

    def __del__(self) -> None:
        if not sys.is_finalizing() and getattr(self, "_handles", None):
            self.free()

    def _factorize_any(self, matrix: sp.csr_matrix, kept: IntArray, *, definite: bool = False) -> FloatArray:
        """Factorize with the first type that can, `definite`: with Cholesky only; its Schur complement (m, m)."""
        if not self._same_pattern(matrix) or not np.array_equal(kept, self._kept):
            self.free()
            self._pattern, self._kept = (matrix.indptr, matrix.indices), kept
            self.begin()
        self._matrix, self.indefinite = matrix, False
        for single in (True, False) if self._try_single else (False,):
            handle = self._handle(2, single)
            try:
                schur = self._factorize(handle)
            except _PardisoError as error:
                if error.value != _NOT_POSITIVE:
                    raise SolveError(f"PARDISO could not factorize the matrix: error {error}") from error
                if definite:
                    break
                continue
            if not single or self._trusted or self._accurate():
                self._trusted = single
                return schur
            self._release(handle)
            self._try_single = False
        self.indefinite = True
        if definite:
            return np.empty((0, 0))
        handle = self._handle(-2, False)
        try:
            self._factorize(handle)
        except _PardisoError as error:
            raise SolveError(SINGULAR) from error
        if handle.options[13] and not self._solves():  # pivots were perturbed
            raise SolveError(SINGULAR)
        return np.empty((0, 0))

    def _factorize(self, handle: _Handle) -> FloatArray:
        assert self._matrix is not None
        self._active = None
        size, m = self._matrix.shape[0], len(self._kept) if handle.kind == 2 else 0
        self._values = _aligned(self._matrix.data, handle.number, self._matrix.data.shape)
        if not handle.analysed:
            handle.options[35] = 2 if m else 0  # form the Schur complement and keep the factors
            handle.options[23] = 1 if m else 0  # which needs the two-level factorization
            handle.chosen = np.zeros(size if m else 0, dtype=np.int32)
            if m:
                handle.chosen[self._kept] = 1
            self._call(handle, _ANALYSE, np.zeros(size))
            handle.analysed = True
        out = self._call(handle, _FACTORIZE, np.zeros(max(size, m * m)))  # the Schur complement is in the solution
        self._active = handle
        return out[: m * m].reshape(m, m)

    def _solves(self) -> bool:
        assert self._matrix is not None
        rhs = np.cos(np.arange(self._matrix.shape[0]))  # no vector that a singular matrix would happen to reach
        residual = symmetric_product(self._matrix, self.solve(rhs)) - rhs
        return bool(np.abs(residual).max() <= 1e-4)

    def _accurate(self) -> bool:
        """Whether a solve is off by less than a hundredth, as a second solve for what it left shows."""
        assert self._matrix is not None
        rhs = np.cos(np.arange(self._matrix.shape[0]))
        found = self.solve(rhs)
        error = self.solve(rhs - symmetric_product(self._matrix, found))
        return bool(np.abs(error).max() <= 0.01 * np.abs(found).max())

    def _same_pattern(self, matrix: sp.csr_matrix) -> bool:
        if self._pattern is None:
            return False
        return all(
            old is new or np.array_equal(old, new)
            for old, new in zip(self._pattern, (matrix.indptr, matrix.indices), strict=True)
        )

    def _handle(self, kind: int, single: bool) -> _Handle:
        if (kind, single) not in self._handles:
            self._handles[kind, single] = _Handle(kind, np.float32 if single else np.float64)
        return self._handles[kind, single]

    def _release(self, handle: _Handle) -> None:
        if handle.analysed:
            self._call(handle, _RELEASE, np.zeros(0))
        handle.analysed = False

    def _call(self, handle: _Handle, phase: int, rhs: FloatArray) -> FloatArray:
        assert self._pattern is not None
        right, solution = (_aligned(values, handle.number, rhs.shape) for values in (rhs, 0.0))
        error = ctypes.c_int32(0)
        starts, columns = (np.ascontiguousarray(part, dtype=np.int32) for part in self._pattern)
        # A single triangular solve is over before a second thread has begun.
        handle.options[24] = int(phase > _FACTORIZE and right.ndim == 1)

        def at(array: Any) -> Any:
            return array.ctypes.data_as(_POINTER)

        def number(value: int) -> Any:
            return ctypes.byref(ctypes.c_int32(value))

        if self.threads is not None:
            self._library.MKL_Set_Num_Threads_Local(int(self.threads))
        try:
            self._pardiso(
                at(handle.pointers), number(1), number(1), number(handle.kind), number(phase), number(len(starts) - 1),
                at(self._values), at(starts), at(columns), at(handle.chosen),
                number(1 if right.ndim == 1 else right.shape[1]), at(handle.options), number(0), at(right),
                at(solution), ctypes.byref(error),
            )
        finally:
            if self.threads is not None:
                self._library.MKL_Set_Num_Threads_Local(0)
        if error.value:
            raise _PardisoError(error.value)
        return np.ascontiguousarray(solution)
