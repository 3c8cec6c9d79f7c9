"""Shape functions of linear tetrahedra: partition of unity, exact gradients of linear fields, volumes."""

import numpy as np

from mixpinn.geometry.tetrahedra import shape_gradients

UNIT = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])


def test_shape_gradients_of_the_unit_tetrahedron_in_either_orientation():
    gradients, volumes = shape_gradients(UNIT, np.array([[0, 1, 2, 3], [0, 2, 1, 3]]))
    np.testing.assert_allclose(volumes, 1.0 / 6.0)
    np.testing.assert_allclose(gradients[0], [[-1.0, -1.0, -1.0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], atol=1e-15)
    np.testing.assert_allclose(gradients[1, [0, 2, 1, 3]], gradients[0], atol=1e-15)


def test_gradients_of_a_linear_field_are_exact():
    rng = np.random.default_rng(1)
    points, slope = 5.0 * rng.normal(size=(8, 3)), rng.normal(size=3)
    cells = np.array([rng.permutation(8)[:4] for _ in range(6)])
    gradients, _ = shape_gradients(points, cells)
    found = np.einsum("ma,mar->mr", (points @ slope + 2.0)[cells], gradients)
    np.testing.assert_allclose(found, np.tile(slope, (6, 1)), rtol=1e-9)
