import numpy as np
import pytest

from mesh.shapes import ball_label_map
from mixpinn.base.errors import InputError
from mixpinn.mesh import DomainSurfaces, Grading, SizingField, Surface, extract_surfaces
from mixpinn.mesh.meshers.grading import probed_skin, surface_points

GRADING = Grading(probed=5.0, rigid=4.0, elsewhere=20.0, growth=0.5, reach=5.0)


@pytest.fixture(scope="module")
def field():
    return SizingField(extract_surfaces(ball_label_map(voxel=2.0, radius=60.0)), GRADING)


def test_lengths_at_known_places(field):
    """A ball of radius 12 in one of radius 60: the hindmost skin is y = 60, the rigid surface 12 from the centre."""
    at = np.array([[0.0, 60.0, 0.0], [12.0, 0.0, 0.0], [0.0, 32.0, 0.0], [0.0, -60.0, 0.0]])
    np.testing.assert_allclose(field(at), [5.0, 4.0, 14.0, 20.0], atol=1.0)


def test_length_grows_no_faster_than_told(field):
    rng = np.random.default_rng(1)
    at = rng.uniform(-50.0, 50.0, (500, 3))
    step = rng.normal(size=(500, 3))
    change = np.abs(field(at + step) - field(at))
    assert (change <= 0.5 * np.linalg.norm(step, axis=1) + 1e-9).all()


def test_probed_skin_is_behind_the_parts():
    body = ball_label_map(voxel=2.0, radius=60.0)
    surfaces = extract_surfaces(body)
    points = surface_points(surfaces.body, 2.0)
    met = points[probed_skin(points, surfaces.rigid[0].points, reach=5.0)]
    assert met[:, 1].min() > 50.0
    assert np.abs(met[:, [0, 2]]).max() <= 18.0


def test_points_of_large_triangles_cover_them():
    square = Surface("square", np.array([[0.0, 0, 0], [40, 0, 0], [40, 40, 0], [0, 40, 0]]),
                     np.array([[0, 1, 2], [0, 2, 3]]))
    points = surface_points(square, 2.0)
    at = np.random.default_rng(0).uniform(0.0, 40.0, (200, 2))
    distance = np.linalg.norm(points[None, :, :2] - at[:, None], axis=2).min(axis=1)
    assert distance.max() <= 3.0
    assert (points[:, 2] == 0.0).all()


def test_a_body_without_rigid_parts_has_a_field():
    surfaces = extract_surfaces(ball_label_map())
    length = SizingField(DomainSurfaces(surfaces.body, ()), GRADING)(np.array([[0.0, 40.0, 0.0], [0.0, -40.0, 0.0]]))
    np.testing.assert_allclose(length, [5.0, 20.0], atol=1.0)


def test_edges_are_short_along_the_border_of_the_held_skin():
    """A ball of radius 60 is held up to 30 mm behind its foremost point: the border is the circle y = −30."""
    surfaces = extract_surfaces(ball_label_map(voxel=2.0, radius=60.0))
    field = SizingField(surfaces, Grading(probed=20.0, rigid=20.0, elsewhere=20.0, fixed=3.0, growth=0.5))
    angle = np.linspace(0.0, np.pi, 7)  # the half with z above 0; the poles z = ±60 stand for the caps
    border = 52.0 * np.stack([np.cos(angle), np.full(7, -30.0 / 52.0), np.sin(angle)], axis=1)
    np.testing.assert_allclose(field(border), 3.0, atol=1.0)
    np.testing.assert_allclose(field(border + np.array([0.0, 20.0, 0.0])), 13.0, atol=1.5)
    assert field(np.array([[0.0, -60.0, 0.0]])).item() > 15.0


def test_scaled_lengths_only():
    twice = GRADING.scaled(2.0)
    assert (twice.probed, twice.rigid, twice.elsewhere, twice.distance) == (10.0, 8.0, 40.0, 2.5)
    assert (twice.reach, twice.growth, twice.near, twice.angle) == (5.0, 0.5, 0.8, 30.0)
    with pytest.raises(InputError, match="positive factor"):
        GRADING.scaled(0.0)
    with pytest.raises(InputError, match=r"grading\.rigid"):
        Grading(rigid=-1.0)
