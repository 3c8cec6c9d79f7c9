from dataclasses import replace

import numpy as np
import pytest

from mixpinn.base.errors import InputError
from mixpinn.records import TissueMesh
from mixpinn.records.mid_edges import edge_index
from mixpinn.records.vtk_file import write_vtk

MESH = TissueMesh(
    np.array([[0, 0, 0], [10, 0, 0], [0, 10, 0], [0, 0, 10], [10, 10, 10.0]]),
    np.array([[0, 1, 2, 3], [1, 4, 2, 3]], dtype=np.int32), np.array([0, 1, 1, 1, 0], dtype=np.int16),
    np.array([True, False, False, False, False]), ("bone",), np.array([0, 1], dtype=np.int16), ("fat", "muscle"),
)


def test_round_trip_keeps_identity_and_names(tmp_path):
    mesh = replace(MESH, rigid_names=("Wirbelkörper \\ 脊椎",), tissue_names=("fat", "µ"))
    mesh.save(tmp_path / "mesh.vtu")
    read = TissueMesh.load(tmp_path / "mesh.vtu")
    assert read.hash() == mesh.hash()
    assert read.rigid_names == mesh.rigid_names
    assert read.tissue_names == mesh.tissue_names
    np.testing.assert_array_equal(read.world_to_scanner, mesh.world_to_scanner)


def test_targets_survive_and_those_that_no_part_has_are_refused(tmp_path):
    """A target that is no part would silently mean that all parts are pressed on."""
    mesh = replace(MESH, rigid_names=("Wirbelkörper",), targets=("Wirbelkörper",))
    mesh.save(tmp_path / "mesh.vtu")
    assert TissueMesh.load(tmp_path / "mesh.vtu").targets == mesh.targets
    replace(mesh, targets=("vertebrae_L9",)).save(tmp_path / "mesh.vtu")
    with pytest.raises(InputError, match="targets: expected names of rigid parts, got 'vertebrae_L9'"):
        TissueMesh.load(tmp_path / "mesh.vtu")


def test_edges_faces_and_volumes_by_hand():
    # Two tetrahedra share the face 1-2-3: nine edges, six boundary faces, of which none is free of part 1.
    assert MESH.edges.tolist() == [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [1, 4], [2, 3], [2, 4], [3, 4]]
    assert MESH.edge_part.tolist() == [0, 0, 0, 1, 1, 0, 1, 0, 0]
    assert len(MESH.boundary_faces) == 6
    assert len(MESH.skin_faces) == 0
    np.testing.assert_allclose(MESH.cell_volumes, [1000 / 6, 2000 / 6])


@pytest.mark.parametrize("content", [b"", b"no mesh", b'<?xml version="1.0"?><VTKFile type="UnstructuredGrid">'])
def test_damaged_file(tmp_path, content, capfd):
    (tmp_path / "mesh.vtu").write_bytes(content)
    with pytest.raises(InputError, match=r"mesh\.vtu"):
        TissueMesh.load(tmp_path / "mesh.vtu")
    assert "ERR" not in capfd.readouterr().err


def two_cells_with_a_part():
    """Two tetrahedra on the face 1, 2, 3; vertices 1, 2 and 4 belong to a part."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]], dtype=float)
    cells = np.array([[0, 1, 2, 3], [1, 2, 3, 4]], dtype=np.int32)
    return TissueMesh(
        points, cells, np.array([0, 1, 1, 0, 1], np.int16), np.array([True, False, False, True, False]), ("bone",),
        np.zeros(2, np.int16), ("soft tissue",),
    )


def test_midpoints_of_a_quadratic_mesh():
    linear = two_cells_with_a_part()
    mesh = linear.with_order(2)
    assert linear.with_order(1) is linear
    assert mesh.hash() != linear.hash() == mesh.with_order(1).hash()
    assert (linear.n_nodes, mesh.n_points, mesh.n_nodes) == (5, 5, 5 + 9)
    np.testing.assert_array_equal(edge_index(mesh, mesh.edges[:, ::-1]), np.arange(9))
    # VTK: midpoints of (0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)
    ends = mesh.cells[:, [[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]]]
    np.testing.assert_allclose(mesh.node_points[mesh.cell_nodes[:, 4:]], mesh.points[ends].mean(axis=2))
    # The boundary face 1, 2, 4 is the part's, so that midpoints of its edges are; of the fixed 0 and 3 no face is.
    on_part = {tuple(edge) for edge in mesh.edges[mesh.node_part[5:] == 1].tolist()}
    assert on_part == {(1, 2), (2, 4), (1, 4)}
    assert not mesh.node_fixed[5:].any()
    np.testing.assert_array_equal(mesh.node_part[:5], mesh.part)


def test_a_chord_between_vertices_of_a_part_is_soft():
    # Three cells around the edge 0–1, which runs through them: its ends are the part's, its midpoint is not.
    points = np.array([[0, 0, -1], [0, 0, 1], [1, 0, 0], [-0.5, 0.8, 0], [-0.5, -0.8, 0]], dtype=float)
    cells = np.array([[0, 1, 2, 3], [0, 1, 3, 4], [0, 1, 4, 2]], dtype=np.int32)
    part = np.array([1, 1, 1, 0, 0], np.int16)
    mesh = TissueMesh(
        points, cells[:, [0, 2, 1, 3]], part, np.zeros(5, bool), ("bone",), np.zeros(3, np.int16), order=2,
    )
    chord = 5 + edge_index(mesh, np.array([0, 1]))
    assert mesh.node_part[chord] == 0
    assert not (mesh.node_part[5:] > 0).any()  # no boundary face has all its vertices in the part
    with pytest.raises(InputError, match="order 1"):
        mesh.with_order(3)


def test_a_quadratic_mesh_survives_its_file(tmp_path):
    mesh = two_cells_with_a_part().with_order(2)
    mesh.save(tmp_path / "mesh.vtu")
    loaded = TissueMesh.load(tmp_path / "mesh.vtu")
    assert loaded.order == 2
    assert loaded.hash() == mesh.hash()
    np.testing.assert_array_equal(loaded.cell_nodes, mesh.cell_nodes)
    moved = mesh.grid(np.ones((mesh.n_nodes, 3)))
    assert moved.celltypes.tolist() == [24, 24]  # VTK_QUADRATIC_TETRA
    assert mesh.grid(np.ones((mesh.n_points, 3))).celltypes.tolist() == [10, 10]
    assert mesh.grid().compute_cell_sizes()["Volume"].sum() == pytest.approx(mesh.cell_volumes.sum())


def test_bent_edges_are_refused(tmp_path):
    mesh = two_cells_with_a_part().with_order(2)
    grid = mesh.grid()
    grid.points[7] += 0.1
    write_vtk(tmp_path / "bent.vtu", grid)
    with pytest.raises(InputError, match="straight edges"):
        TissueMesh.load(tmp_path / "bent.vtu")


def test_forces_as_vertices_see_them_keep_force_and_moment():
    mesh = two_cells_with_a_part().with_order(2)
    nodal = np.random.default_rng(0).normal(size=(mesh.n_nodes, 3))
    vertices = mesh.on_vertices(nodal)
    np.testing.assert_allclose(vertices.sum(axis=0), nodal.sum(axis=0), atol=1e-12)
    np.testing.assert_allclose(
        np.cross(mesh.points, vertices).sum(axis=0), np.cross(mesh.node_points, nodal).sum(axis=0), atol=1e-12,
    )


def test_skin_between_nodes_has_the_area_of_the_skin():
    mesh = two_cells_with_a_part().with_order(2)
    assert mesh.skin_node_faces.shape == (0, 6)
    free = replace(mesh, part=np.zeros(5, np.int16), rigid_names=())
    a, b, c = np.moveaxis(free.points[free.skin_faces], 1, 0)
    d, e, f = np.moveaxis(free.node_points[free.skin_triangles].reshape(-1, 4, 3, 3), 2, 0)
    whole, quarters = np.cross(b - a, c - a), np.cross(e - d, f - d)
    np.testing.assert_allclose(quarters, np.repeat(whole[:, None] / 4.0, 4, axis=1), atol=1e-12)
