"""BFGS updates of a factorized matrix against dense algebra, whole and in halves, in double and single precision."""

import importlib.util

import numpy as np
import pytest
import scipy.sparse as sp

from mixpinn.fem.solve.halves import CholeskyHalves, Halves, WholeSolves, in_halves
from mixpinn.fem.solve.linear import LinearSolver, SuperLUSolver
from mixpinn.fem.solve.pardiso import PardisoSolver
from mixpinn.fem.solve.quasi_newton import UpdatedInverse

N = 40
KEPT = np.array([0, 3, 7, 8, 21])
MKL = pytest.mark.skipif(importlib.util.find_spec("pypardiso") is None, reason="MKL is not installed on this platform")
SOLVERS = [
    pytest.param(SuperLUSolver, 1e-10, id="superlu"),
    pytest.param(lambda: PardisoSolver(threads=1), 1e-10, id="pardiso", marks=MKL),
    pytest.param(lambda: PardisoSolver(threads=1, single=True), 1e-4, id="single", marks=MKL),
]


def spd(seed: int) -> np.ndarray:
    root = np.random.default_rng(seed).normal(size=(N, N))
    return root @ root.T / N + np.eye(N)


def upper(matrix: np.ndarray) -> sp.csr_matrix:
    return sp.csr_matrix(np.triu(matrix))


def halves(solver: LinearSolver, matrix: np.ndarray, kept: np.ndarray = KEPT) -> Halves:
    return in_halves(solver, N, kept, solver.factorize_with_compliance(upper(matrix), kept))


class Dense:
    """BFGS on a dense inverse, by its formula."""

    def __init__(self, matrix: np.ndarray) -> None:
        self.inverse = np.linalg.inv(matrix)

    def update(self, s: np.ndarray, y: np.ndarray) -> None:
        rho = 1.0 / (s @ y)
        left = np.eye(N) - rho * np.outer(s, y)
        self.inverse = left @ self.inverse @ left.T + rho * np.outer(s, s)


@pytest.mark.parametrize(("make", "tolerance"), SOLVERS)
@pytest.mark.parametrize("kept", [KEPT, KEPT[:0]], ids=["contact", "none"])
def test_solves_with_forces_like_dense_bfgs(make, tolerance, kept):
    matrix, guess, rng = spd(1), spd(2), np.random.default_rng(5)
    dense, learnt = Dense(guess), UpdatedInverse(halves(make(), guess, kept))
    old = rng.normal(size=N)
    for count in range(12):  # beyond the room for pairs at first
        free = learnt.look(old)
        np.testing.assert_allclose(free, (dense.inverse @ old)[kept], atol=tolerance)
        np.testing.assert_allclose(learnt.compliance, dense.inverse[np.ix_(kept, kept)], atol=tolerance)
        force, loaded = rng.normal(size=len(kept)), old.copy()
        loaded[kept] += force
        np.testing.assert_allclose(learnt.step(force), dense.inverse @ loaded, atol=tolerance)
        np.testing.assert_allclose(learnt.step(), dense.inverse @ old, atol=tolerance)
        step = rng.normal(size=N)
        new = old + matrix @ step
        learnt.learn(step, old, new, guess @ step)
        dense.update(step, new - old)
        assert len(learnt) == count + 1
        old = new if count % 3 else rng.normal(size=N)  # where another residual follows, the pair is taken in alone
    learnt.learn(rng.normal(size=N), old, old, np.ones(N))  # no curvature
    learnt.look(old)
    assert len(learnt) == 12
    np.testing.assert_allclose(learnt.compliance, dense.inverse[np.ix_(kept, kept)], atol=tolerance)


@MKL
def test_an_iteration_costs_one_solve(monkeypatch):
    solver, matrix, rng = PardisoSolver(threads=1), spd(3), np.random.default_rng(0)
    inner = halves(solver, matrix)
    assert isinstance(inner, CholeskyHalves)
    calls = {"forward": 0, "backward": 0}

    def count(name):
        old = getattr(solver, name)

        def counted(vector):
            calls[name] += 1
            return old(vector)

        monkeypatch.setattr(solver, name, counted)

    for name in calls:
        count(name)
    learnt, old = UpdatedInverse(inner), rng.normal(size=N)
    for _ in range(4):
        learnt.look(old)
        step = learnt.step(rng.normal(size=len(KEPT)))
        new = old + 1.1 * matrix @ step
        learnt.learn(step, old, new, matrix @ step)
        old = new
    assert calls == {"forward": 4, "backward": 4}


@pytest.mark.parametrize(("make", "tolerance"), SOLVERS)
def test_a_force_on_the_kept_unknowns_is_not_rounded_with_the_rest(make, tolerance):
    matrix = spd(4)
    inner = halves(make(), matrix)
    load = np.zeros(N)
    load[KEPT] = 1e4
    half = inner.forward(load)
    answer = inner.backward(half.image, half.kept - inner.compliance @ load[KEPT], -load[KEPT])
    assert np.abs(answer).max() < 1e-9


@MKL
def test_an_indefinite_matrix_is_solved_whole():
    solver, matrix = PardisoSolver(threads=1, single=True), spd(6) - 2.0 * np.eye(N)
    assert np.linalg.eigvalsh(matrix)[0] < 0.0
    inner, vector = halves(solver, matrix), np.random.default_rng(1).normal(size=N)
    assert solver.indefinite
    assert isinstance(inner, WholeSolves)
    half = inner.forward(vector)
    np.testing.assert_allclose(half.kept, np.linalg.solve(matrix, vector)[KEPT], atol=1e-9)


@MKL
def test_single_precision_gives_way_where_it_would_be_far_off():
    matrix = np.eye(N) + 1e7 * np.outer(np.ones(N), np.ones(N))
    solver = PardisoSolver(threads=1, single=True)
    solver.factorize(upper(matrix))
    rhs = np.cos(np.arange(N))
    np.testing.assert_allclose(solver.solve(rhs), np.linalg.solve(matrix, rhs), atol=2e-2)
