import importlib.util
import sys

import numpy as np
import pytest
import scipy.sparse as sp

from mixpinn.base.errors import SolveError
from mixpinn.fem.solve.linear import SuperLUSolver, default_solver, symmetric_product
from mixpinn.fem.solve.pardiso import PardisoSolver

SOLVERS = [
    pytest.param(lambda: PardisoSolver(threads=1), id="pardiso", marks=pytest.mark.skipif(
        importlib.util.find_spec("pypardiso") is None, reason="MKL is not installed on this platform",
    )),
    pytest.param(SuperLUSolver, id="superlu"),
]


def matrix(n: int = 60, shift: float = 0.0, seed: int = 0) -> sp.csr_matrix:
    """Upper triangle of a sparse matrix that is positive definite where `shift` is small."""
    random = sp.random(n, n, density=0.08, rng=np.random.default_rng(seed))
    return sp.csr_matrix(sp.triu(random @ random.T + sp.diags(np.linspace(1.0, 3.0, n) - shift), format="csr"))


def full(upper: sp.csr_matrix) -> np.ndarray:
    dense = upper.toarray()
    return dense + np.triu(dense, 1).T


@pytest.mark.parametrize("make", SOLVERS)
@pytest.mark.parametrize("shape", [(60,), (60, 3)], ids=str)
def test_solves_like_dense_algebra(make, shape):
    upper, rhs = matrix(), np.random.default_rng(1).normal(size=shape)
    solver = make()
    solver.factorize(upper)
    assert not solver.indefinite
    np.testing.assert_allclose(solver.solve(rhs), np.linalg.solve(full(upper), rhs), atol=1e-11)


@pytest.mark.parametrize("make", SOLVERS)
def test_notices_an_indefinite_matrix_and_still_solves(make):
    solver, rhs = make(), np.ones(60)
    good, bad = matrix(), matrix()
    bad.data[bad.indptr[:-1]] -= 2.2
    assert np.linalg.eigvalsh(full(bad))[0] < 0.0
    for upper, indefinite in ((good, False), (bad, True), (good, False), (bad, True)):
        solver.factorize(upper)
        assert solver.indefinite is indefinite
        np.testing.assert_allclose(solver.solve(rhs), np.linalg.solve(full(upper), rhs), atol=1e-9)


@pytest.mark.parametrize("make", SOLVERS)
def test_takes_new_values_and_new_patterns(make):
    solver, rhs = make(), np.ones(60)
    first = matrix()
    second = sp.csr_matrix((2.0 * first.data, first.indices, first.indptr), shape=first.shape)
    for upper in (first, second, matrix(60, seed=7), matrix(40, seed=2)):
        solver.factorize(upper)
        size = upper.shape[0]
        np.testing.assert_allclose(solver.solve(rhs[:size]), np.linalg.solve(full(upper), rhs[:size]), atol=1e-11)


@pytest.mark.parametrize("make", SOLVERS)
def test_refuses_a_singular_matrix_and_solving_first(make):
    with pytest.raises(SolveError, match="no matrix"):
        make().solve(np.ones(3))
    values, columns, starts = np.array([1.0, 0.0, 0.0, 1.0]), np.array([0, 1, 2, 2]), np.array([0, 1, 3, 4])
    singular = sp.csr_matrix((values, columns, starts), shape=(3, 3))
    with pytest.raises(SolveError):
        make().factorize(singular)


def test_symmetric_product_uses_both_triangles():
    upper, vectors = matrix(), np.random.default_rng(2).normal(size=(60, 2))
    np.testing.assert_allclose(symmetric_product(upper, vectors), full(upper) @ vectors, atol=1e-12)
    np.testing.assert_allclose(symmetric_product(upper, vectors[:, 0]), full(upper) @ vectors[:, 0], atol=1e-12)


def test_fallback_where_mkl_is_absent(monkeypatch):
    monkeypatch.setitem(sys.modules, "pypardiso", None)  # importing it fails
    upper, solver = matrix(), default_solver(threads=1)
    assert isinstance(solver, SuperLUSolver)
    solver.factorize(upper)
    np.testing.assert_allclose(symmetric_product(upper, solver.solve(np.ones(60))), 1.0, atol=1e-11)


def test_default_solver_solves():
    upper, solver = matrix(), default_solver(threads=1)
    solver.factorize(upper)
    np.testing.assert_allclose(symmetric_product(upper, solver.solve(np.ones(60))), 1.0, atol=1e-11)
