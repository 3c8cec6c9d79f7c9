"""The distance from a probe on its grid: against closed forms, its gradient, its side, its underside."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from mixpinn.geometry.probe_shapes import linear_probe, spherical_probe
from mixpinn.press.probe_field import FAR, LINEAR_ERROR, ProbeField, distance_about, shadow_columns, signed_distance
from mixpinn.press.step_kernel import STEEPEST

RADIUS = 12.0


@pytest.fixture(scope="module")
def ball():
    return ProbeField.of_probe(spherical_probe(radius=RADIUS, subdivisions=4), gap=2.0)


def test_a_ball_has_the_distance_of_a_ball(ball) -> None:
    points = np.random.default_rng(0).uniform(-16.0, 16.0, (2000, 3)) + np.array([0.0, RADIUS, 0.0])
    true = np.linalg.norm(points - [0.0, RADIUS, 0.0], axis=1) - RADIUS
    near = np.abs(true) < 5.0
    distance, gradient = ball.at(points[near])
    assert_allclose(distance, true[near], atol=0.03)  # the facets lie inside the ball
    assert_allclose(np.linalg.norm(gradient, axis=1), 1.0, atol=0.03)


def test_the_gradient_is_the_derivative(ball) -> None:
    points = np.random.default_rng(1).uniform(-8.0, 8.0, (50, 3)) + np.array([0.0, -1.0, 0.0])
    step = 1e-4 * np.eye(3)
    ahead = np.stack([ball.at(points + by)[0] - ball.at(points - by)[0] for by in step], axis=1) / 2e-4
    assert_allclose(ball.at(points)[1], ahead, atol=2e-3)


def test_the_side_does_not_depend_on_the_orientation_of_the_triangles() -> None:
    probe = linear_probe()
    points = np.array([[0.0, 5.0, 0.0], [0.0, -3.0, 0.0], [10.0, 3.0, 2.0], [40.0, 10.0, 0.0]])
    expected = [-5.0, 3.0, -3.0, 11.5]
    for triangles in (probe.triangles, probe.triangles[:, ::-1]):
        assert_allclose(signed_distance(points, probe.points, triangles), expected, atol=0.05)


def test_off_the_grid_everything_is_far(ball) -> None:
    distance, gradient = ball.at(np.array([[100.0, 0.0, 0.0]]))
    assert distance[0] == FAR
    assert not gradient.any()


def test_the_underside_is_where_a_plane_would_be_met(ball) -> None:
    """Below the centre the gap is reached 2 mm under the tip; at a distance ρ the sphere of R + gap curves up."""
    x = ball.origin[0] + ball.spacing * np.arange(len(ball.underside))
    middle = round(-float(ball.origin[2]) / ball.spacing)
    row, z = ball.underside[:, middle], ball.origin[2] + ball.spacing * middle
    inner = np.hypot(x, z) < 8.0
    expected = RADIUS - np.sqrt((RADIUS + 2.0) ** 2 - x[inner] ** 2 - z**2)
    assert_allclose(row[inner], expected, atol=0.04)
    assert np.isinf(row[np.abs(x) > RADIUS + 3.5]).all()


@pytest.mark.parametrize("probe", [linear_probe(), spherical_probe(radius=9.0)], ids=["linear", "ball"])
def test_a_cheap_distance_is_never_larger_by_more_than_it_says_nor_does_the_distance_change_faster(probe) -> None:
    """What contact leaves out because of either lies outside the gap."""
    field = ProbeField.of_probe(probe, gap=0.5)
    high = field.origin + field.spacing * (np.array(field.coefficients.shape) - 1)
    points = np.random.default_rng(2).uniform(field.origin, high, size=(20_000, 3))
    distance, gradient = field.at(points)
    grid = field.coefficients.ravel(), np.array(field.coefficients.shape), field.origin, field.spacing
    about = np.array([distance_about(*grid, point) for point in points])
    outside = (distance > field.gap) & (distance < FAR)
    assert outside.sum() > 5_000
    assert ((about == FAR) == (distance == FAR)).all()
    assert (about - distance)[outside].max() < LINEAR_ERROR * field.spacing
    assert np.linalg.norm(gradient[outside], axis=1).max() < STEEPEST


def test_the_shadow_is_where_the_probe_comes_down(ball) -> None:
    columns = shadow_columns(ball, 2.0)
    assert columns is not None
    below = np.argwhere(ball.underside < 2.0)
    np.testing.assert_array_equal(columns, [below.min(axis=0), below.max(axis=0)])
    assert shadow_columns(ball, -1e3) is None


def test_second_derivatives_are_those_of_the_distance(ball) -> None:
    rng, step = np.random.default_rng(4), 1e-4
    places = rng.uniform([-6.0, -3.0, -6.0], [6.0, 2.0, 6.0], (60, 3))
    found = ball.bend(places)
    for r in range(3):
        way = step * np.eye(3)[r]
        slope = (ball.at(places + way)[1] - ball.at(places - way)[1]) / (2.0 * step)
        np.testing.assert_allclose(found[:, r], slope, atol=1e-4 * np.abs(found).max())
