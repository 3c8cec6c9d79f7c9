import numpy as np
import pytest
import pyvista as pv

from mixpinn.base.errors import InputError
from mixpinn.mesh import DomainSurfaces, Surface, check_surface, check_surfaces, self_intersections


def ball(radius=10.0, centre=(0.0, 0.0, 0.0), name="ball"):
    data = pv.Icosphere(radius=radius, center=centre, nsub=2)
    return Surface(name, np.asarray(data.points, dtype=float), np.asarray(data.regular_faces, dtype=np.int64))


def test_sound_surface_passes_and_is_turned_outward():
    assert check_surface(ball().reversed()).volume == pytest.approx(ball().volume)


def test_open_surface():
    whole = ball()
    with pytest.raises(InputError, match="3 border edges"):
        check_surface(Surface("open", whole.points, whole.triangles[1:]))


def test_triangle_turned_over():
    whole = ball()
    triangles = whole.triangles.copy()
    triangles[0] = triangles[0, ::-1]
    with pytest.raises(InputError, match="turned over"):
        check_surface(Surface("turned", whole.points, triangles))


def test_vertex_pulled_through_the_other_side():
    whole = ball()
    points = whole.points.copy()
    points[0] *= -1.5
    with pytest.raises(InputError, match="triangles that cross"):
        check_surface(Surface("crossed", points, whole.triangles))


def test_two_crossing_triangles_are_found():
    points = np.array([[0.0, 0, 0], [4, 0, 0], [0, 4, 0], [1, 1, -1], [1, 1, 1], [9, 9, 1]])
    np.testing.assert_array_equal(self_intersections(points, np.array([[0, 1, 2], [3, 4, 5]])), [[0, 1]])
    points[3:, 2] += 5.0
    assert not len(self_intersections(points, np.array([[0, 1, 2], [3, 4, 5]])))


def test_rigid_part_outside_the_body():
    with pytest.raises(InputError, match="inside body"):
        check_surfaces(DomainSurfaces(ball(30.0, name="body"), (ball(5.0, (28.0, 0.0, 0.0)),)))


def test_overlapping_rigid_parts():
    parts = (ball(6.0, (-4.0, 0.0, 0.0), "a"), ball(6.0, (4.0, 0.0, 0.0), "b"))
    with pytest.raises(InputError, match="disjoint"):
        check_surfaces(DomainSurfaces(ball(30.0, name="body"), parts))


def test_unreadable_surface(tmp_path):
    (tmp_path / "bad.stl").write_text("not a surface")
    with pytest.raises(InputError):
        Surface.load(tmp_path / "bad.stl")
