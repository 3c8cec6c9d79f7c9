from dataclasses import replace

import numpy as np
import pytest

from mesh.shapes import box_mesh
from mixpinn.mesh import mesh_quality, refine_to

CAVITY = np.s_[1:3, 1:3, 1:2]


def bent_box():
    mesh = box_mesh((4, 5, 4), cavity=CAVITY)
    moved = mesh.points + np.random.default_rng(5).uniform(-1.5, 1.5, mesh.points.shape)
    return replace(mesh, points=moved, fixed=mesh.points[:, 1] < -10.0)


def near_the_corner(points):
    """4 mm at one corner of the box, growing by half of the distance from it."""
    return 4.0 + 0.5 * np.linalg.norm(points - [20.0, 25.0, 20.0], axis=1)


def surface_area(mesh, part=None):
    faces = mesh.boundary_faces
    if part is not None:
        faces = faces[(mesh.part[faces] == part).all(axis=1)]
    a, b, c = np.moveaxis(mesh.points[faces], 1, 0)
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()


@pytest.fixture(scope="module")
def pair():
    mesh = bent_box()
    return mesh, refine_to(mesh, near_the_corner)


def test_no_edge_is_longer_than_wanted(pair):
    _, fine = pair
    ends = fine.points[fine.edges]
    lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    assert (lengths <= near_the_corner(ends.mean(axis=1)) * (1.0 + 1e-12)).all()


def test_cells_fill_the_same_volume(pair):
    mesh, fine = pair
    assert (fine.cell_volumes > 0.0).all()
    assert fine.cell_volumes.sum() == pytest.approx(mesh.cell_volumes.sum(), rel=1e-12)


def test_the_mesh_is_conforming_and_its_facets_are_kept(pair):
    """A hanging node would leave inner faces without a partner, and the boundary would have a larger area."""
    mesh, fine = pair
    assert surface_area(fine) == pytest.approx(surface_area(mesh), rel=1e-12)
    assert surface_area(fine, 1) == pytest.approx(surface_area(mesh, 1), rel=1e-12)
    assert mesh_quality(fine).branching_edges == mesh_quality(mesh).branching_edges


def test_nodes_are_kept_and_refinement_is_local(pair):
    mesh, fine = pair
    np.testing.assert_array_equal(fine.points[: mesh.n_points], mesh.points)
    new = np.linalg.norm(fine.points[mesh.n_points :] - [20.0, 25.0, 20.0], axis=1)
    old = np.linalg.norm(mesh.points - [20.0, 25.0, 20.0], axis=1)
    assert np.median(new) < 0.6 * np.median(old)


def test_angles_stay(pair):
    """Bisection of the longest edge: the smallest angle of a regular family falls by a bounded factor."""
    mesh, fine = pair
    finer = refine_to(mesh, lambda points: 0.5 * near_the_corner(points))
    assert mesh_quality(fine).min_dihedral > 0.4 * mesh_quality(mesh).min_dihedral
    assert mesh_quality(finer).min_dihedral > 0.4 * mesh_quality(mesh).min_dihedral


def test_nothing_to_do():
    mesh = bent_box()
    assert refine_to(mesh, lambda points: np.full(len(points), 100.0)) is mesh


def test_equal_edges_are_cut_in_one_order():
    """A grid of equal cubes, where every diagonal is as long as the next, ends and keeps its volume."""
    fine = refine_to(box_mesh((3, 3, 3)), lambda points: np.full(len(points), 6.0))
    assert fine.cell_volumes.sum() == pytest.approx(30.0**3)
    assert (fine.cell_volumes > 0.0).all()
