"""The condensed contact problem, against its closed forms."""

import numpy as np
import pytest

from mixpinn.physics.condensed_contact import newton_step, solve_condensed


def spd(n: int, seed: int) -> np.ndarray:
    root = np.random.default_rng(seed).normal(size=(n, n))
    return root @ root.T + n * np.eye(n)


def wall(stiffness: float):
    """One-sided springs that act where y > 0, on all unknowns."""
    def law(y: np.ndarray, exact: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        on = np.flatnonzero(y > 0.0)
        return stiffness * np.maximum(y, 0.0), stiffness * np.eye(len(on)), on
    return law


@pytest.mark.parametrize("touched", [[], [2], [0, 3, 4, 9, 10], list(range(12))])
def test_newton_step_is_that_of_dense_algebra(touched: list[int]) -> None:
    rng, on = np.random.default_rng(len(touched)), np.array(touched, dtype=np.int64)
    compliance, error = np.linalg.inv(spd(12, 1)), rng.normal(size=12)
    stiffness = 50.0 * rng.normal(size=(len(on), len(on)))  # neither symmetric nor definite
    stiffness[rng.random(stiffness.shape) < 0.4] = 0.0
    change, move = np.empty(12), np.empty(12)
    assert newton_step(compliance, error, stiffness, on, change, move)
    whole = np.zeros((12, 12))
    whole[np.ix_(on, on)] = stiffness
    expected = np.linalg.solve(np.eye(12) + whole @ compliance, error)
    np.testing.assert_allclose(change, expected, atol=1e-10)
    np.testing.assert_allclose(move, compliance @ expected, atol=1e-10)


def test_a_newton_step_that_does_not_exist_is_reported() -> None:
    assert not newton_step(np.eye(2), np.ones(2), -np.eye(2), np.arange(2), np.empty(2), np.empty(2))


@pytest.mark.parametrize("seed", range(5))
def test_one_sided_springs_satisfy_their_complementarity(seed: int) -> None:
    compliance, free = np.linalg.inv(spd(12, seed)), np.random.default_rng(seed).normal(size=12)
    found = solve_condensed(compliance, free, wall(1e8), start=np.zeros(12), largest_move=10.0)
    assert found.converged
    np.testing.assert_allclose(found.increment, free - compliance @ found.force, atol=1e-8)  # tolerance · |λ|
    # In the limit of stiff springs: y ≤ 0, λ ≥ 0, y λ = 0; springs of 1e8 under forces below 1e3 leave 1e-5.
    assert found.increment.max() <= 1e-5
    assert (found.force >= 0.0).all()
    assert np.abs(found.increment * found.force).max() <= 1e-2


def test_without_contact_the_body_goes_free() -> None:
    free = np.array([-1.0, -2.0])
    found = solve_condensed(np.eye(2), free, wall(1.0), start=np.array([0.3, 0.0]), largest_move=0.1)
    assert found.converged
    np.testing.assert_allclose(found.increment, free, atol=1e-9)


def test_a_law_without_solution_is_reported() -> None:
    def law(y: np.ndarray, exact: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return np.full(1, 1.0 if y[0] > 0.0 else -1.0), np.zeros((1, 1)), np.array([0])  # y = −sign(y) · 1 … jumps
    assert not solve_condensed(np.eye(1), np.zeros(1), law, start=np.zeros(1), largest_move=1.0).converged
