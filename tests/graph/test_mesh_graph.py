"""The graph of a mesh."""

from dataclasses import replace

import numpy as np
import pytest
import pyvista as pv
import torch

from mixpinn.base.errors import InputError
from mixpinn.graph import build_graph
from mixpinn.records import TissueMesh


def test_two_cells(two_cells: TissueMesh) -> None:
    graph = build_graph(two_cells)
    pairs = {tuple(pair) for pair in graph.edge_index.T.tolist()}
    undirected = {(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3), (1, 4), (2, 4), (3, 4)}
    assert pairs == undirected | {(j, i) for i, j in undirected}
    assert graph.n_edges == len(pairs) == graph.n_mesh_edges
    assert {tuple(pair) for pair in graph.mesh_rigid_edges.T.tolist()} == {(0, 1), (1, 0), (1, 4), (4, 1)}
    assert torch.equal(graph.rigid_edges, graph.mesh_rigid_edges)
    assert graph.rest_length(torch.tensor([[0], [1]])).item() == pytest.approx(3.0 * 2**0.5)
    assert (graph.n_nodes, graph.n_parts, graph.n_inputs, graph.mesh_hash) == (5, 1, 10, two_cells.hash())
    assert graph.part_nodes(1).tolist() == [0, 1, 4]


def test_edge_length_is_the_first_edge_feature(random_mesh) -> None:
    graph = build_graph(random_mesh(0))
    torch.testing.assert_close(graph.edge_length.double(), graph.rest_length(graph.edge_index), atol=1e-5, rtol=1e-6)


def test_a_mesh_without_cells_is_refused(two_cells: TissueMesh) -> None:
    with pytest.raises(InputError, match="at least one cell"):
        build_graph(replace(two_cells, cells=np.zeros((0, 4), np.int32)))


def test_paper_mesh_has_the_edges_of_the_paper(shared_data) -> None:
    grid = pv.read(shared_data / "patient1" / "paper" / "body.vtu")
    cells = np.asarray(grid.cells_dict[pv.CellType.TETRA], np.int32)
    graph = build_graph(TissueMesh(
        np.asarray(grid.points, np.float64), cells, np.asarray(grid.point_data["rigid"]).astype(np.int16),
        np.zeros(grid.n_points, bool), ("L1", "L2", "L3", "L4", "L5"), np.zeros(len(cells), np.int16),
    ))
    assert graph.node_features.shape == (8746, 11)
    assert graph.edge_features.shape == (96698, 6)
    # The paper's table of the mesh.
    assert torch.bincount(graph.edge_part).tolist() == [74896, 3372, 4634, 4350, 4766, 4680]
    assert graph.mesh_rigid_edges.shape[1] == 21802
