"""Contact points of the skin: their areas and places are a quadrature over the triangles."""

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from mixpinn.press.skin_points import SkinPoints

POINTS = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0, 0.0, 10.0], [11.0, 2.0, 9.0]])
TRIANGLES = np.array([[0, 1, 2], [1, 3, 2]])


def test_areas_add_up_and_linear_functions_are_integrated_exactly() -> None:
    found = SkinPoints.of_triangles(POINTS, TRIANGLES, spacing=4.0)
    edges = POINTS[TRIANGLES[:, 1:]] - POINTS[TRIANGLES[:, :1]]
    area = 0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    assert_allclose([found.area[found.face == t].sum() for t in range(2)], area)
    places = np.einsum("pw,pwk->pk", found.weights, POINTS[found.stencil])
    for t in range(2):
        on = found.on_faces(np.array([t]))
        mean = (found.area[on, None] * places[on]).sum(axis=0) / found.area[on].sum()
        assert_allclose(mean, POINTS[TRIANGLES[t]].mean(axis=0))


def test_parts_are_no_longer_than_the_spacing_and_lie_inside() -> None:
    found = SkinPoints.of_triangles(POINTS, TRIANGLES, spacing=3.0)
    assert_array_equal(np.bincount(found.face), [25, 25])
    assert (found.weights > 0.0).all()
    assert_allclose(found.weights.sum(axis=1), 1.0)


def test_a_uniform_pressure_on_a_face_of_six_nodes_loads_its_midpoints_alone() -> None:
    corners = np.array([[0.0, 0.0, 0.0], [9.0, 0.0, 0.0], [1.0, 0.0, 7.0]])
    nodes = np.concatenate([corners, 0.5 * (corners + np.roll(corners, -1, axis=0))])
    found = SkinPoints.of_faces(nodes, np.arange(6)[None], spacing=4.0)
    assert_allclose(found.area.sum(), 31.5)
    assert len(found.area) % 3 == 0
    load = np.zeros(6)
    np.add.at(load, found.stencil, found.area[:, None] * found.weights)
    assert_allclose(load, 31.5 * np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]) / 3.0, atol=1e-12)
    # They move with the face: a field of second order is met exactly at every point.
    places = np.einsum("pw,pwk->pk", found.weights, nodes[found.stencil])

    def bent(at):
        return 1.0 + 0.3 * at[:, 0] - 0.02 * at[:, 0] * at[:, 2] + 0.05 * at[:, 2] ** 2

    assert_allclose(np.einsum("pw,pw->p", found.weights, bent(nodes)[found.stencil]), bent(places), atol=1e-12)
