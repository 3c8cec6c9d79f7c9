"""Linear solvers for symmetric matrices given by their upper triangle, behind one protocol."""

from typing import Any, Protocol

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from mixpinn.base.arrays import FloatArray, IntArray
from mixpinn.base.errors import SolveError

SINGULAR = "the matrix is singular: is every soft part held, or joined to one that is?"


class LinearSolver(Protocol):
    """Solves A x = b for symmetric A.

    Attributes:
        indefinite: whether the last factorized matrix turned out not to be positive definite.
    """

    indefinite: bool

    def begin(self) -> None:
        """Forget what earlier matrices have taught: what follows does not depend on them."""
        ...

    def factorize(self, matrix: sp.csr_matrix) -> None:
        """Factorize the matrix whose upper triangle is `matrix` (n, n): sorted CSR, all diagonal entries stored.

        Raises:
            SolveError: the matrix is singular.
        """
        ...

    def factorize_with_compliance(
        self, matrix: sp.csr_matrix, kept: IntArray, *, definite: bool = False,
    ) -> FloatArray:
        """Factorize as `factorize` does, and return the block of the inverse that belongs to the unknowns `kept`.

        Args:
            matrix: as for `factorize`.
            kept: ascending indices of unknowns, shape (m,).
            definite: nothing but a positive definite matrix is of use. Where `indefinite` then says that it is none,
                nothing was factorized and what is returned means nothing.

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


def default_solver(threads: int | None = None, *, single: bool = False) -> LinearSolver:
    """PARDISO where Intel's library is installed, else SuperLU.

    Args:
        threads: for PARDISO; by default as many as ``OMP_NUM_THREADS`` or the machine says.
        single: single precision is enough, where it is faster; see `PardisoSolver`.
    """
    from mixpinn.fem.solve.pardiso import PardisoSolver

    try:
        return PardisoSolver(threads=threads, single=single)
    except ImportError:
        return SuperLUSolver()


def compliance_by_solves(solver: LinearSolver, size: int, kept: IntArray) -> FloatArray:
    """Block (m, m) of the inverse of the last factorized matrix (size, size), from one solve per kept unknown."""
    unit = np.zeros((size, len(kept)))
    unit[kept, np.arange(len(kept))] = 1.0
    block = solver.solve(unit)[kept] if len(kept) else np.empty((0, 0))
    symmetric: FloatArray = 0.5 * (block + block.T)
    return symmetric


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

    def begin(self) -> None:
        """See `LinearSolver.begin`."""

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
            raise SolveError(SINGULAR) from error
        # With pivots on the diagonal A = L D Lᵀ up to a permutation, so that the signs of D are the inertia.
        self.indefinite = bool((self._factor.U.diagonal() <= 0.0).any())

    def factorize_with_compliance(
        self, matrix: sp.csr_matrix, kept: IntArray, *, definite: bool = False,
    ) -> FloatArray:
        """See `LinearSolver.factorize_with_compliance`."""
        self.factorize(matrix)
        if definite and self.indefinite:
            return np.empty((0, 0))
        return compliance_by_solves(self, matrix.shape[0], kept)

    def solve(self, rhs: FloatArray) -> FloatArray:
        """See `LinearSolver.solve`."""
        if self._factor is None:
            raise SolveError("no matrix was factorized yet")
        solution: FloatArray = self._factor.solve(np.asarray(rhs, dtype=np.float64))
        return solution
