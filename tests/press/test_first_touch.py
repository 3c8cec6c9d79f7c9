"""How deep a place lies in the way of a probe: the underside of a ball in closed form."""

import numpy as np

from mixpinn.geometry.probe_shapes import spherical_probe
from mixpinn.geometry.rotations import rotation_from_vector
from mixpinn.press.first_touch import deepest_touch, touch_depths
from mixpinn.press.probe_field import ProbeField
from mixpinn.press.skin_points import SkinPoints

RADIUS, GAP = 10.0, 2.0


def depths_of(points, rotation, translation):
    ball = ProbeField.of_probe(spherical_probe(radius=RADIUS, subdivisions=4), gap=GAP)
    found = np.empty(len(points))
    touch_depths(points, rotation, translation, ball.underside, ball.origin, ball.spacing, found)
    return found


def test_depths_along_the_axis_of_a_ball():
    rng = np.random.default_rng(0)
    rotation, tip = rotation_from_vector(np.array([0.3, 0.2, -0.4])), np.array([5.0, -2.0, 1.0])
    local = rng.uniform([-8.0, -20.0, -8.0], [8.0, 5.0, 8.0], (200, 3))
    beside = local[:, 0] ** 2 + local[:, 2] ** 2
    local = local[beside < 64.0]
    # All that is nearer than the gap lies in a ball of radius r + g about (0, r, 0): its lower half is the underside.
    underside = RADIUS - np.sqrt((RADIUS + GAP) ** 2 - local[:, 0] ** 2 - local[:, 2] ** 2)
    found = depths_of(local @ rotation.T + tip, rotation, tip)
    np.testing.assert_allclose(found, local[:, 1] - underside, atol=0.05)


def test_places_beside_the_probe_are_in_nobodys_way():
    far = np.array([[60.0, 0.0, 0.0], [0.0, -5.0, 60.0], [RADIUS + GAP + 3.0, 0.0, 0.0]])
    assert np.isneginf(depths_of(far, np.eye(3), np.zeros(3))).all()


def test_the_deepest_place_is_found_whatever_is_passed_over():
    ball = ProbeField.of_probe(spherical_probe(radius=RADIUS, subdivisions=4), gap=GAP)
    rng = np.random.default_rng(1)
    x, z = (axis.ravel() for axis in np.meshgrid(np.linspace(-40.0, 40.0, 17), np.linspace(-40.0, 40.0, 17)))
    points = np.stack([x, rng.uniform(-2.0, 2.0, len(x)), z], axis=1)
    corner = np.array([17 * i + j for i in range(16) for j in range(16)])
    faces = np.concatenate([corner[:, None] + [0, 1, 17], corner[:, None] + [1, 18, 17]])
    skin = SkinPoints.of_triangles(points, faces, spacing=3.0)
    places = np.einsum("pw,pwk->pk", skin.weights, points[skin.stencil])
    starts, balls = skin.balls(places, len(faces))
    assert (np.linalg.norm(places - balls[skin.face, :3], axis=1) <= balls[skin.face, 3]).all()
    for _ in range(20):
        rotation = rotation_from_vector(rng.uniform(-0.5, 0.5, 3))
        probe = (rotation, rng.uniform(-45.0, 45.0, 3), ball.underside, ball.origin, ball.spacing)
        found = np.empty(len(places))
        touch_depths(places, *probe, found)
        assert deepest_touch(places, starts, balls, *probe) == found.max()
