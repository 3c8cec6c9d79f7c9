"""The face kernel at single points: the nearest triangle by brute force, a plane in closed form."""

import numpy as np
import pytest

from mixpinn.fem.contact.face_kernel import bounding_capsules, evaluate_faces, nearest_on_probe, nearest_within
from mixpinn.physics.contact_law import ContactConstants, penalty


def test_the_nearest_triangle_is_that_of_brute_force():
    rng = np.random.default_rng(0)
    corners = rng.normal(size=(30, 3))
    triangles = rng.permuted(np.tile(np.arange(30), (12, 1)), axis=1)[:, :3]
    i, j = np.meshgrid(np.arange(61), np.arange(61), indexing="ij")
    i, j = i[i + j <= 60] / 60.0, j[i + j <= 60] / 60.0
    weights = np.column_stack([i, j, 1.0 - i - j])
    cloud = np.einsum("qa,tai->tqi", weights, corners[triangles])
    capsules = bounding_capsules(corners[triangles])
    for point in rng.normal(scale=2.0, size=(40, 3)):
        t, wa, wb, wc, squared, _ = nearest_on_probe(point, np.arange(12), corners, triangles)
        place = np.array([wa, wb, wc]) @ corners[triangles[t]]
        assert ((point - place) ** 2).sum() == pytest.approx(squared)
        sampled = np.sqrt(((cloud - point) ** 2).sum(axis=2).min())
        assert np.sqrt(squared) <= sampled + 1e-12
        assert sampled - np.sqrt(squared) < 0.05  # the cloud's points lie so close
        within = nearest_within(point, np.arange(12), corners, triangles, capsules, np.sqrt(squared) + 0.1)
        assert within[0] == t
        assert within[4] == pytest.approx(squared)


@pytest.mark.parametrize("exact", [True, False])
def test_a_point_under_a_plane_carries_the_penalty_of_its_area(exact):
    corners = np.array([[-50.0, 0.0, -50.0], [50.0, 0.0, -50.0], [0.0, 0.0, 80.0]])
    law, gap, area, height = ContactConstants(7.0, 0.1, 0.0, 7.0), 2.0, 3.0, 1.4
    energy, worst, hits, gradient, stiffness, touched, force, slip = evaluate_faces(
        np.array([[1.0, -height, 2.0]]), np.zeros((1, 1), np.int64), np.ones((1, 1)), np.full(1, area),
        np.array([0, 1]), np.array([0]), corners, np.array([[0, 1, 2]]), bounding_capsules(corners[None]), law, gap,
        np.zeros(1, np.bool_), np.zeros((1, 3)), np.zeros((1, 3)), exact,
    )
    phi, slope, curvature = penalty(gap - height, 7.0, 0.1)
    assert (hits, touched.tolist()) == (1, [True])
    assert worst == pytest.approx(gap - height)
    assert energy == pytest.approx(area * phi)
    assert force[0] == pytest.approx(area * slope)
    np.testing.assert_allclose(gradient, [[0.0, area * slope, 0.0]], atol=1e-12)
    np.testing.assert_allclose(stiffness, np.diag([0.0, area * curvature, 0.0]), atol=1e-12)
    assert not slip.any()
