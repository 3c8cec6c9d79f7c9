"""Gaussian elimination against LAPACK."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from mixpinn.physics.elimination import solve_in_place, symmetric_times


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 7, 8, 30, 61])
def test_it_solves_what_lapack_solves(n) -> None:
    rng = np.random.default_rng(n)
    matrix, rhs = rng.normal(size=(n, n)), rng.normal(size=n)
    solution = rhs.copy()
    assert solve_in_place(matrix.copy(), solution)
    assert_allclose(solution, np.linalg.solve(matrix, rhs), rtol=1e-9, atol=1e-9)


def test_pivots_are_sought_and_singular_matrices_noticed() -> None:
    rhs = np.array([1.0, 2.0])
    assert solve_in_place(np.array([[0.0, 1.0], [1.0, 0.0]]), rhs)
    assert_allclose(rhs, [2.0, 1.0])
    assert not solve_in_place(np.zeros((3, 3)), np.ones(3))


@pytest.mark.parametrize("n", [1, 2, 5, 12, 31])
def test_products_with_zeros_in_between(n) -> None:
    rng = np.random.default_rng(n)
    matrix, out = rng.normal(size=(n, n)), np.empty(n)
    matrix += matrix.T
    for zeros in range(n + 1):
        vector = rng.normal(size=n)
        vector[rng.permutation(n)[:zeros]] = 0.0
        symmetric_times(matrix, vector, out)
        assert_allclose(out, matrix @ vector, rtol=1e-12, atol=1e-12)
