"""Linear solvers for symmetric matrices given by their upper triangle, behind one protocol."""

import sys
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from mixpinn.base.arrays import FloatArray, IntArray
from mixpinn.base.errors import SolveError

_SINGULAR = "the matrix is singular: is every soft part held, or joined to one that is?"


class LinearSolver(Protocol):
    """Solves A x = b for symmetric A.

    Attributes:
        indefinite: whether the last factorized matrix turned out not to be positive definite.
    """

    indefinite: bool

    def factorize(self, matrix: sp.csr_matrix) -> None:
        """Factorize the matrix whose upper triangle is `matrix` (n, n): sorted CSR, all diagonal entries stored.

        Raises:
            SolveError: the matrix is singular.
        """
        ...

    def factorize_with_compliance(self, matrix: sp.csr_matrix, kept: IntArray) -> FloatArray:
        """Factorize as `factorize` does, and return the block of the inverse that belongs to the unknowns `kept`.

        Args:
            matrix: as for `factorize`.
            kept: ascending indices of unknowns, shape (m,).

        Returns:
            Symmetric, shape (m, m).

        Raises:
            SolveError: the matrix is singular.
        """
        ...

    def solve(self, rhs: FloatArray) -> FloatArray:
        """Solution for one right-hand side (n,) or several (n, k) with the last factorization."""
        ...


def symmetric_product(matrix: sp.csr_matrix, vector: FloatArray) -> FloatArray:
    """A x for the symmetric matrix A whose upper triangle is `matrix` (n, n); x of shape (n,) or (n, k)."""
    diagonal = matrix.diagonal()
    product: FloatArray = matrix @ vector + matrix.T @ vector
    product -= (diagonal * vector.T).T
    return product


def default_solver(threads: int | None = None) -> LinearSolver:
    """PARDISO where Intel's library is installed, else SuperLU.

    Args:
        threads: for PARDISO; by default as many as ``OMP_NUM_THREADS`` or the machine says.
    """
    try:
        return PardisoSolver(threads=threads)
    except ImportError:
        return SuperLUSolver()


def compliance_by_solves(solver: LinearSolver, size: int, kept: IntArray) -> FloatArray:
    """Block (m, m) of the inverse of the last factorized matrix (size, size), from one solve per kept unknown."""
    unit = np.zeros((size, len(kept)))
    unit[kept, np.arange(len(kept))] = 1.0
    block = solver.solve(unit)[kept] if len(kept) else np.empty((0, 0))
    symmetric: FloatArray = 0.5 * (block + block.T)
    return symmetric


class PardisoSolver:
    """MKL PARDISO on the upper triangle.

    Cholesky (matrix type 2) as long as the matrices are positive definite, which is several times faster than the
    unsymmetric type 11 that the Python package defaults to; a matrix that turns out indefinite is factorized again
    with Bunch-Kaufman pivoting (type −2), and `indefinite` says so. The symbolic analysis is kept while the pattern
    stays the same, for each of the two types.

    The block of the inverse comes from the Schur complement that PARDISO forms on its way when it eliminates the
    unknowns `kept` last: the two together cost what the factorization alone does.

    Args:
        threads: threads of MKL; by default as many as ``OMP_NUM_THREADS`` or the machine says.

    Raises:
        ImportError: no MKL for this platform.
    """

    def __init__(self, *, threads: int | None = None) -> None:
        import pypardiso  # absent on platforms without MKL

        self._make: Callable[[int], Any] = lambda kind: pypardiso.PyPardisoSolver(mtype=kind)
        self._error: type[Exception] = pypardiso.pardiso_wrapper.PyPardisoError
        self._handles: dict[int, Any] = {}
        self._analysed: dict[int, bool] = {}
        self._pattern: tuple[IntArray, IntArray] | None = None
        self._matrix: sp.csr_matrix | None = None
        self._kept: IntArray = np.empty(0, dtype=np.int64)
        self.threads = threads
        self.indefinite = False
        self._handle(2)

    def factorize(self, matrix: sp.csr_matrix) -> None:
        """See `LinearSolver.factorize`."""
        self._factorize_any(matrix, np.empty(0, dtype=np.int64))

    def factorize_with_compliance(self, matrix: sp.csr_matrix, kept: IntArray) -> FloatArray:
        """See `LinearSolver.factorize_with_compliance`."""
        schur = self._factorize_any(matrix, np.asarray(kept, dtype=np.int64))
        if self.indefinite:
            return compliance_by_solves(self, matrix.shape[0], kept)
        inverse = np.linalg.inv(schur)
        symmetric: FloatArray = 0.5 * (inverse + inverse.T)
        return symmetric

    def _factorize_any(self, matrix: sp.csr_matrix, kept: IntArray) -> FloatArray:
        """Factorize with one type or the other; the Schur complement (m, m) if it was the first."""
        if not self._same_pattern(matrix) or not np.array_equal(kept, self._kept):
            self.free()
            self._pattern, self._kept = (matrix.indptr, matrix.indices), kept
        self._matrix = matrix
        self.indefinite = False
        schur = np.empty((0, 0))
        try:
            schur = self._factorize(2)
        except self._error as error:
            if error.value != -4:  # type: ignore[attr-defined]
                raise SolveError(f"PARDISO could not factorize the matrix: error {error}") from error
            self.indefinite = True
            try:
                self._factorize(-2)
            except self._error as second:
                raise SolveError(_SINGULAR) from second
            if self._handle(-2).iparm[13] and not self._solves():  # pivots were perturbed
                raise SolveError(_SINGULAR) from None
        return schur

    def solve(self, rhs: FloatArray) -> FloatArray:
        """See `LinearSolver.solve`."""
        if self._matrix is None:
            raise SolveError("no matrix was factorized yet")
        return self._call(-2 if self.indefinite else 2, 33, np.asfortranarray(rhs, dtype=np.float64))

    def free(self) -> None:
        """Release the memory of the factorizations."""
        for kind, handle in self._handles.items():
            if self._analysed.get(kind):
                handle.free_memory(everything=True)
        self._analysed.clear()
        self._matrix = self._pattern = None

    def __del__(self) -> None:
        if not sys.is_finalizing() and getattr(self, "_handles", None):
            self.free()

    def _same_pattern(self, matrix: sp.csr_matrix) -> bool:
        if self._pattern is None:
            return False
        return all(
            old is new or np.array_equal(old, new)
            for old, new in zip(self._pattern, (matrix.indptr, matrix.indices), strict=True)
        )

    def _factorize(self, kind: int) -> FloatArray:
        assert self._matrix is not None
        size, m = self._matrix.shape[0], len(self._kept) if kind == 2 else 0
        handle = self._handle(kind)
        if not self._analysed.get(kind):
            handle.iparm[35] = 2 if m else 0  # form the Schur complement and keep the factors
            handle.iparm[23] = 1 if m else 0  # which needs the two-level factorization
            handle.perm = np.zeros(size if m else 0, dtype=np.int32)
            if m:
                handle.perm[self._kept] = 1
            self._call(kind, 11, np.zeros(size))
            self._analysed[kind] = True
        out = self._call(kind, 22, np.zeros(max(size, m * m)))  # the Schur complement is written to the solution
        return out[: m * m].reshape(m, m)

    def _solves(self) -> bool:
        assert self._matrix is not None
        rhs = np.cos(np.arange(self._matrix.shape[0]))  # no vector that a singular matrix would happen to reach
        residual = symmetric_product(self._matrix, self.solve(rhs)) - rhs
        return bool(np.abs(residual).max() <= 1e-4)

    def _handle(self, kind: int) -> Any:
        if kind not in self._handles:
            handle = self._handles[kind] = self._make(kind)
            handle.iparm[0] = 1  # what follows are no defaults
            handle.iparm[1] = 2  # nested dissection (METIS)
            handle.iparm[7] = 2 if kind == -2 else 0  # steps of iterative refinement
            handle.iparm[9] = 8  # pivots below 1e-8 are perturbed
            if kind == -2:
                handle.iparm[20] = 1  # Bunch-Kaufman
        return self._handles[kind]

    def _call(self, kind: int, phase: int, rhs: FloatArray) -> FloatArray:
        handle = self._handle(kind)
        # A single triangular solve is over before a second thread has begun.
        handle.iparm[24] = 1 if phase == 33 and rhs.ndim == 1 else 0
        if self.threads is not None:
            handle.libmkl.MKL_Set_Num_Threads_Local(int(self.threads))
        handle.set_phase(phase)
        try:
            solution: FloatArray = handle._call_pardiso(self._matrix, rhs)
        finally:
            if self.threads is not None:
                handle.libmkl.MKL_Set_Num_Threads_Local(0)
        return solution


class SuperLUSolver:
    """SciPy's SuperLU in symmetric mode: no pivoting off the diagonal, minimum degree on AᵀA's pattern A + Aᵀ.

    Runs everywhere, on one thread; about 8 times as fast as SciPy's default settings on these matrices.
    """

    def __init__(self) -> None:
        self.indefinite = False
        self._factor: Any = None
        self._pattern: tuple[IntArray, IntArray] | None = None
        self._template: sp.csc_matrix | None = None
        self._source: IntArray | None = None

    def factorize(self, matrix: sp.csr_matrix) -> None:
        """See `LinearSolver.factorize`."""
        if self._pattern is None or self._pattern[0] is not matrix.indptr or self._pattern[1] is not matrix.indices:
            # Which entry of the triangle each entry of the full matrix is: a full matrix of indices, counted from one.
            counted = sp.csr_matrix(
                (np.arange(1, matrix.nnz + 1), matrix.indices, matrix.indptr), shape=matrix.shape,
            )
            self._template = (counted + sp.triu(counted, 1).T).tocsc()
            self._source = self._template.data.astype(np.int64) - 1
            self._pattern = (matrix.indptr, matrix.indices)
        assert self._template is not None
        assert self._source is not None
        full = sp.csc_matrix(
            (matrix.data[self._source], self._template.indices, self._template.indptr), shape=matrix.shape,
        )
        try:
            self._factor = splu(
                full, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True},
            )
        except RuntimeError as error:
            raise SolveError(_SINGULAR) from error
        # With pivots on the diagonal A = L D Lᵀ up to a permutation, so that the signs of D are the inertia.
        self.indefinite = bool((self._factor.U.diagonal() <= 0.0).any())

    def factorize_with_compliance(self, matrix: sp.csr_matrix, kept: IntArray) -> FloatArray:
        """See `LinearSolver.factorize_with_compliance`."""
        self.factorize(matrix)
        return compliance_by_solves(self, matrix.shape[0], kept)

    def solve(self, rhs: FloatArray) -> FloatArray:
        """See `LinearSolver.solve`."""
        if self._factor is None:
            raise SolveError("no matrix was factorized yet")
        solution: FloatArray = self._factor.solve(np.asarray(rhs, dtype=np.float64))
        return solution
