"""The contact law: derivatives by finite differences, stick and slip in closed form, nothing without contact."""

import numpy as np
import pytest

from mixpinn.physics.contact_law import penalty, return_slip, slip_derivative

STIFFNESS, SMOOTHING = 500.0, 0.02
NORMAL = np.array([2.0, -1.0, 2.0]) / 3.0


@pytest.mark.parametrize("violation", [0.003, 0.0199, 0.0201, 0.4])
def test_force_and_stiffness_are_derivatives_of_the_energy(violation):
    step = 1e-6
    above, below = (penalty(violation + sign * step, STIFFNESS, SMOOTHING) for sign in (1.0, -1.0))
    _, force, stiffness = penalty(violation, STIFFNESS, SMOOTHING)
    assert (above[0] - below[0]) / (2.0 * step) == pytest.approx(force, rel=1e-6)
    assert (above[1] - below[1]) / (2.0 * step) == pytest.approx(stiffness, rel=1e-6)


def test_a_deep_violation_is_a_spring_that_begins_half_the_smoothing_late():
    assert penalty(0.3, STIFFNESS, SMOOTHING)[1] == pytest.approx(STIFFNESS * (0.3 - 0.01))
    assert penalty(0.0, STIFFNESS, SMOOTHING) == (0.0, 0.0, 0.0)
    assert penalty(-1.0, STIFFNESS, SMOOTHING) == (0.0, 0.0, 0.0)


def force_of(slip, limit):
    """T and f, u for an elastic slip."""
    e, u = np.array(slip, dtype=float), np.empty(3)
    factor, sticks, energy = return_slip(e, NORMAL, limit, 40.0, u)
    return factor * e, factor, u, sticks, energy


def test_friction_lies_across_the_normal_and_within_the_cone():
    slip = np.array([0.3, 0.1, -0.2])
    across = slip - (slip @ NORMAL) * NORMAL
    held, _, u, sticks, energy = force_of(slip, 1e3)
    assert sticks
    np.testing.assert_allclose(held, 40.0 * across, rtol=1e-12)
    assert energy == pytest.approx(20.0 * across @ across)
    assert not u.any()
    sliding, _, u, sticks, _ = force_of(slip, 2.0)
    assert not sticks
    np.testing.assert_allclose(sliding, 2.0 * across / np.linalg.norm(across), rtol=1e-12)
    np.testing.assert_allclose(u @ NORMAL, 0.0, atol=1e-15)


@pytest.mark.parametrize("limit", [1e3, 2.0])
def test_derivatives_of_friction(limit):
    slip, step = np.array([0.3, 0.1, -0.2]), 1e-6
    _, factor, u, sticks, _ = force_of(slip, limit)
    found = factor * np.array([[slip_derivative(r, c, NORMAL, u) for c in range(3)] for r in range(3)])
    expected = np.array([
        (force_of(slip + step * axis, limit)[0] - force_of(slip - step * axis, limit)[0]) / (2.0 * step)
        for axis in np.eye(3)
    ]).T
    np.testing.assert_allclose(found, expected, atol=1e-6)
    by_limit = (force_of(slip, limit + step)[0] - force_of(slip, limit - step)[0]) / (2.0 * step)
    np.testing.assert_allclose(u, by_limit, atol=1e-6)  # ∂T/∂N = μ u, and the limit is μ N
    assert sticks == (limit > 100.0)
