"""Cholesky's factorization against LAPACK."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from mixpinn.physics.cholesky import cholesky_in_place, cholesky_solve


@pytest.mark.parametrize("n", [0, 1, 2, 7, 8, 9, 40])
def test_it_solves_what_lapack_solves(n) -> None:
    rng = np.random.default_rng(n)
    root, rhs = rng.normal(size=(n, n + 2)), rng.normal(size=n)
    matrix = root @ root.T + 0.1 * np.eye(n)
    lower, solution = matrix.copy(), rhs.copy()
    assert cholesky_in_place(lower)
    assert_allclose(np.tril(lower), np.linalg.cholesky(matrix), rtol=1e-9, atol=1e-12)
    cholesky_solve(lower, solution)
    assert_allclose(solution, np.linalg.solve(matrix, rhs), rtol=1e-8, atol=1e-10)


def test_a_matrix_that_is_not_positive_is_noticed() -> None:
    assert not cholesky_in_place(np.array([[1.0, 2.0], [2.0, 1.0]]))
    assert not cholesky_in_place(np.zeros((3, 3)))
    assert not cholesky_in_place(np.full((2, 2), np.nan))
