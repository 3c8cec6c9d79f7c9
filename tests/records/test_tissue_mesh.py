from dataclasses import replace

import numpy as np
import pytest

from mixpinn.base.errors import InputError
from mixpinn.records import TissueMesh

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
