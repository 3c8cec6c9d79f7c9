"""One point on springs under a ball: equilibrium in closed form, Coulomb's bound, and a path without memory."""

import numpy as np
import pytest
from scipy.optimize import brentq

from mixpinn.geometry.probe_shapes import linear_probe, spherical_probe
from mixpinn.physics.contact_law import penalty
from mixpinn.press.path_kernel import Path, Skin, follow
from mixpinn.press.probe_field import ProbeField
from mixpinn.press.records import PlacedFields
from mixpinn.press.step_kernel import Contacts, point_force, solve_step

GAP, SPRING, STIFFNESS, SMOOTHING = 2.0, 0.4, 5.0, 0.1
ONE = np.ones((1, 1))
FIRST = np.zeros((1, 1), np.int64)


@pytest.fixture(scope="module")
def fields():
    ball = ProbeField.of_probe(spherical_probe(radius=10.0, subdivisions=4), gap=GAP)
    return PlacedFields((ball,), np.eye(3)[None], np.zeros((1, 3))).joined


def press(fields, height, *, friction=0.0, before=None, lift=0.0):
    """One point that would lie `height` below the ball's tip without contact, on a spring in each direction."""
    place = np.array([[0.0, -height, 0.0]])
    forces, found, converged, _ = solve_step(
        place, np.full((1, 3), [0.0, lift, 0.0]), SPRING * np.eye(3), np.zeros(3), Contacts(
            np.zeros((1, 2), np.int64), FIRST, ONE, np.full(1, STIFFNESS), fields, np.eye(3)[None], np.zeros((1, 3)),
            place.copy() if before is None else before, np.zeros((1, 3)), np.zeros(1), (GAP, friction, SMOOTHING),
        ), np.ones(1, bool), np.zeros((1, 4)), 1e-9, (60, 1000),
    )
    return forces, found.push, found.slip, found.pull, converged


def spring_force(height):
    """N with N = φ'(g − h − c N)."""
    return brentq(lambda force: penalty(GAP - height - SPRING * force, STIFFNESS, SMOOTHING)[1] - force, 0.0, 50.0)


@pytest.mark.parametrize("height", [1.9, 1.0, 0.2])
@pytest.mark.parametrize("lift", [0.0, 0.3])
def test_the_force_on_a_spring_is_that_of_the_closed_form(fields, height, lift):
    forces, push, slip, pull, converged = press(fields, height, lift=lift)
    assert converged
    expected = spring_force(height)
    # The ball's surface is flat between its corners, and its distance is interpolated: 0.02 mm in all.
    assert push[0] == pytest.approx(expected, abs=STIFFNESS * 0.02)
    np.testing.assert_allclose(pull[0], [0.0, -push[0], 0.0], atol=0.02 * push[0])
    np.testing.assert_allclose(forces, -pull[0], atol=1e-12)
    assert not slip.any() or np.abs(slip).max() < 0.02


def test_beyond_the_gap_nothing_acts(fields):
    forces, push, _, _, converged = press(fields, 2.1)
    assert converged
    assert not forces.any()
    assert not push.any()


@pytest.mark.parametrize("friction", [0.1, 0.5])
def test_a_point_dragged_far_slips_at_coulombs_bound(fields, friction):
    before = np.array([[-3.0, -1.0, 0.0]])  # where it lay in the ball's frame before the ball moved
    _, push, slip, pull, converged = press(fields, 1.0, friction=friction, before=before)
    assert converged
    # N along the normal and μ N across it, whichever way the normal leans
    assert np.linalg.norm(pull[0]) == pytest.approx(push[0] * np.hypot(1.0, friction), rel=1e-6)
    assert pull[0, 0] < -0.9 * friction * push[0]
    assert np.linalg.norm(slip[0]) == pytest.approx(friction * push[0] / STIFFNESS, rel=1e-6)


def test_without_friction_a_path_ends_where_one_step_does(fields):
    steps = np.linspace(2.5, 0.5, 6)
    translations = np.zeros((6, 1, 3))
    translations[:, 0, 1] = steps  # the ball comes down on a point at the origin
    force, _, push, _, done, _ = follow(
        np.zeros((1, 3)), SPRING * np.eye(3), Skin(FIRST, ONE, np.full(1, STIFFNESS)), fields,
        Path(np.tile(np.eye(3), (6, 1, 1, 1)), translations, np.zeros((6, 1, 3))), np.zeros(3), np.zeros((1, 1, 3)),
        np.zeros((1, 1)), np.zeros((1, 1)), (GAP, 0.0, SMOOTHING), (1e-9, 1e-9), (60, 1000),
    )
    assert done == 5
    expected = press(fields, 0.5)
    np.testing.assert_allclose(force, expected[0], atol=1e-6)
    assert push[0, 0] == pytest.approx(expected[1][0], abs=1e-6)


@pytest.mark.parametrize("friction", [0.0, 0.2, 5.0])
def test_the_slope_of_a_points_force_is_its_derivative(friction):
    # At the rim of the probe the normal turns within few millimetres.
    probe = ProbeField.of_probe(linear_probe(), gap=GAP)
    low, high = probe.probe.points.min(axis=0), probe.probe.points.max(axis=0)
    rng, step, seen = np.random.default_rng(1), 1e-5, 0
    field = (probe.coefficients.ravel(), np.array(probe.coefficients.shape), probe.origin, probe.spacing)

    def ask(place, before):
        normal, force, slip, slope = np.empty(3), np.empty(3), np.empty(3), np.empty((3, 3))
        push = point_force(
            place, before, np.array([0.05, -0.1, 0.02]), 0.0, STIFFNESS, (GAP, friction, SMOOTHING), field,
            normal, force, slip, slope, tuple(np.empty((2, 3))) + tuple(np.empty((2, 3, 3))),
        )
        return push, force, slope

    for place in rng.uniform([low[0] - 1.5, -1.7, low[2] - 1.5], [high[0] + 1.5, 1.0, high[2] + 1.5], (400, 3)):
        before = place + rng.uniform(-0.6, 0.6, 3)
        push, _, slope = ask(place, before)
        if push < 2.0 * STIFFNESS * SMOOTHING or probe.at(place[None])[0][0] < 0.5:
            continue
        seen += 1
        moved = np.array([(ask(place + step * way, before)[1] - ask(place - step * way, before)[1]) / (2.0 * step)
                          for way in np.eye(3)]).T
        np.testing.assert_allclose(-slope, moved, atol=2e-4 * np.abs(slope).max())
    assert seen > 50
