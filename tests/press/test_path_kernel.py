"""How deep a place lies in the way of a probe: the underside of a ball in closed form."""

import numpy as np

from mixpinn.geometry.probe_shapes import spherical_probe
from mixpinn.geometry.rotations import rotation_from_vector
from mixpinn.press.path_kernel import touch_depths
from mixpinn.press.probe_field import ProbeField

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
