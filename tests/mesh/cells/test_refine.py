from dataclasses import replace

import numpy as np
import pytest

from fem.block_mesh import carved, two_bones
from mesh.shapes import box_mesh
from mixpinn.mesh import mesh_quality, refine
from mixpinn.records import TissueMesh
from mixpinn.records.mid_edges import edge_index, mid_edge_labels

CAVITY = np.s_[1:3, 1:3, 1:2]


def bent_box():
    """A box with a cavity and fixed nodes, its nodes moved at random, so that no two cells are alike."""
    mesh = box_mesh((4, 5, 4), cavity=CAVITY)
    moved = mesh.points + np.random.default_rng(3).uniform(-1.5, 1.5, mesh.points.shape)
    return replace(mesh, points=moved, fixed=mesh.points[:, 1] < -10.0)


def areas(points, faces):
    corners = points[faces]
    return 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)


def test_each_cell_becomes_eight_of_the_same_volume():
    mesh = bent_box()
    finer = refine(mesh)
    assert finer.n_points == mesh.n_points + len(mesh.edges)
    assert (finer.cell_volumes > 0.0).all()
    children = finer.cell_volumes.reshape(-1, 8)
    np.testing.assert_allclose(children, np.repeat(mesh.cell_volumes[:, None] / 8.0, 8, axis=1), rtol=1e-9)


def test_nodes_are_the_old_ones_and_the_middles():
    mesh = bent_box()
    finer = refine(mesh)
    np.testing.assert_array_equal(finer.points[: mesh.n_points], mesh.points)
    np.testing.assert_allclose(finer.points[mesh.n_points :], mesh.points[mesh.edges].mean(axis=1))


def test_facets_are_kept():
    """Every face of the finer boundary is a quarter of one of the coarser, and together they cover it."""
    mesh = bent_box()
    finer = refine(mesh)
    assert len(finer.boundary_faces) == 4 * len(mesh.boundary_faces)
    coarse, fine = areas(mesh.points, mesh.boundary_faces), areas(finer.points, finer.boundary_faces)
    np.testing.assert_allclose(np.sort(fine), np.sort(np.repeat(coarse / 4.0, 4)), rtol=1e-9)


def test_labels_follow_surfaces():
    """New nodes of a part and new fixed nodes are the middles of edges on the surface, counted from the faces."""
    mesh = bent_box()
    finer = refine(mesh)
    wall = mesh.boundary_faces[(mesh.part[mesh.boundary_faces] == 1).all(axis=1)]
    assert (finer.part == 1).sum() == (mesh.part == 1).sum() + 3 * len(wall) // 2
    held = mesh.skin_faces[mesh.fixed[mesh.skin_faces].all(axis=1)]
    middles = finer.fixed[mesh.n_points :]
    sides = {tuple(sorted(pair)) for face in held for pair in zip(face, np.roll(face, 1), strict=True)}
    assert {tuple(edge) for edge in mesh.edges[middles]} == sides
    walls = finer.boundary_faces[(finer.part[finer.boundary_faces] == 1).all(axis=1)]
    assert areas(finer.points, walls).sum() == pytest.approx(areas(mesh.points, wall).sum())


def test_an_edge_through_tissue_between_two_walls_is_soft():
    """A U of cubes round one cube of tissue: edges across the tissue have both ends on the part and are soft."""
    solid = np.zeros((5, 4, 3), dtype=bool)
    solid[1:4, 1:3, 1] = True
    solid[2, 2, 1] = False
    mesh = box_mesh((5, 4, 3), cavity=solid)
    part, _ = mid_edge_labels(mesh)
    across = (mesh.edge_part == 1) & (part == 0)
    assert across.any()
    middles = mesh.points[mesh.edges[across]].mean(axis=1)
    # The hollow cube spans x −5 … 5, y 0 … 10, z −5 … 5 in the mesh's frame; its mouth is the face y = 10.
    assert (np.abs(middles[:, [0, 2]]) <= 5.0).all()
    assert ((middles[:, 1] >= 0.0) & (middles[:, 1] <= 10.0)).all()


def test_tissue_is_the_parents():
    mesh = box_mesh((2, 2, 2))
    mesh = replace(mesh, tissue=np.arange(len(mesh.cells)).astype(np.int16) % 3, tissue_names=("a", "b", "c"))
    np.testing.assert_array_equal(refine(mesh).tissue, np.repeat(mesh.tissue, 8))


def test_angles_do_not_go_worse_without_end():
    mesh = bent_box()
    once = refine(mesh)
    twice = refine(once)
    assert mesh_quality(twice).min_dihedral == pytest.approx(mesh_quality(once).min_dihedral, rel=0.3)


def test_the_regular_tetrahedron_is_halved():
    points = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    volume = np.linalg.det(points[1:] - points[0])
    cells = np.array([[0, 1, 2, 3] if volume > 0 else [1, 0, 2, 3]], dtype=np.int32)
    mesh = TissueMesh(points, cells, np.zeros(4, np.int16), np.zeros(4, bool), (), np.zeros(1, np.int16))
    finer = refine(mesh)
    lengths = np.linalg.norm(np.diff(finer.points[finer.edges], axis=1)[:, 0], axis=1)
    edge = np.linalg.norm(points[1] - points[0])
    assert np.isclose(lengths, edge / 2.0).sum() == len(finer.edges) - 1
    assert lengths.max() == pytest.approx(edge / np.sqrt(2.0))


def test_edges_are_found_in_either_order():
    mesh = box_mesh((2, 2, 2))
    rows = np.random.default_rng(0).permutation(len(mesh.edges))
    np.testing.assert_array_equal(edge_index(mesh, mesh.edges[rows][:, ::-1]), rows)


def test_a_part_that_is_held_is_held_where_it_is_cut_finer() -> None:
    carved_block = carved(two_bones())
    mesh = replace(carved_block, fixed=carved_block.part == 1)
    assert mesh.held_parts.tolist() == [True, False]
    finer = refine(mesh)
    assert finer.held_parts.tolist() == [True, False]
    assert finer.fixed[finer.part == 1].all()
    assert finer.with_order(2).node_fixed[finer.with_order(2).node_part == 1].all()
