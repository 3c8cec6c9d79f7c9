"""The system of pushed points and that of touched nodes have the same solution, that of dense algebra."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from mixpinn.press.newton_direction import newton_direction, resistance
from mixpinn.press.step_kernel import Contacts, Forces

NODES = 9


def some_contact(width: int, points: int, pushed: int):
    """Contacts with unsymmetric stiffness, of which some are pushed, and the dense B and D of these."""
    rng = np.random.default_rng(10 * width + points)
    stencil = np.array([rng.permutation(NODES)[:width] for _ in range(points)])
    weights = rng.dirichlet(np.ones(width), size=points)
    push = np.zeros(points)
    push[rng.permutation(points)[:pushed]] = 1.0
    slope = rng.normal(size=(points, 3, 3)) + 4.0 * np.eye(3)
    none, zeros = np.zeros((points, 3)), np.zeros(points)
    contacts = Contacts(
        np.zeros((points, 2), np.int64), stencil, weights, zeros, None, np.eye(3)[None], np.zeros((1, 3)), none, none,
        zeros, (2.0, 1.0, 0.1),
    )
    forces = Forces(np.zeros((NODES, 3)), slope, push, none, none, np.zeros((points, 4)))
    on = np.flatnonzero(push)
    spread = np.zeros((len(on), NODES))
    np.add.at(spread, (np.arange(len(on))[:, None], stencil[on]), weights[on])
    whole = np.kron(spread, np.eye(3))
    stiff = np.zeros((3 * len(on), 3 * len(on)))
    for k, point in enumerate(on):
        stiff[3 * k:, 3 * k:][:3, :3] = slope[point]
    return contacts, forces, whole.T @ stiff @ whole


@pytest.mark.parametrize("width", [1, 3, 6])
@pytest.mark.parametrize(("points", "pushed"), [(4, 2), (5, 5), (40, 30)])  # fewer and more of them than nodes
def test_the_step_is_that_of_dense_algebra(width, points, pushed) -> None:
    contacts, forces, stiffness = some_contact(width, points, pushed)
    rng = np.random.default_rng(1)
    root, error = rng.normal(size=(3 * NODES, 3 * NODES)), rng.normal(size=3 * NODES)
    compliance = root @ root.T / 30.0
    change, move, held = np.empty((3, 3 * NODES))
    assert newton_direction(compliance, contacts, forces, error, change, move)
    expected = np.linalg.solve(np.eye(3 * NODES) + stiffness @ compliance, error)
    assert_allclose(change, expected, rtol=1e-9, atol=1e-10)
    assert_allclose(move, compliance @ expected, rtol=1e-9, atol=1e-10)
    resistance(contacts, forces, move, held)
    assert_allclose(held, stiffness @ move, rtol=1e-9, atol=1e-9)


def test_without_a_pushed_point_the_step_is_the_error() -> None:
    contacts, forces, _ = some_contact(3, 4, 0)
    error, change, move = np.arange(27.0), np.empty(27), np.empty(27)
    assert newton_direction(np.eye(27), contacts, forces, error, change, move)
    assert_allclose(change, error)
    assert_allclose(move, error)
