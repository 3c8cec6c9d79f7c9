"""Virtual edges, by hand and on random meshes."""

import pytest
import torch

from mixpinn.graph import VirtualEdges, VirtualNodes, build_graph
from mixpinn.graph.virtual_edges import reference_node
from mixpinn.records import TissueMesh


def test_two_cells(two_cells: TissueMesh) -> None:
    graph = VirtualEdges()(build_graph(two_cells))
    assert reference_node(graph, 1) == 0
    # 0-1 is an edge of the mesh already; only 0-4 is new.
    assert sorted(graph.edge_index[:, graph.n_mesh_edges:].T.tolist()) == [[0, 4], [4, 0]]
    assert graph.edge_features[graph.n_mesh_edges:, 0].tolist() == pytest.approx([54.0**0.5] * 2)
    assert graph.edge_features[graph.n_mesh_edges:, 1].tolist() == [1.0, 1.0]
    assert graph.n_nodes == 5


@pytest.mark.parametrize("seed", range(4))
def test_every_rigid_node_is_one_hop_from_its_reference_and_no_edge_is_double(random_mesh, seed: int) -> None:
    graph = VirtualEdges()(build_graph(random_mesh(seed)))
    pairs = [tuple(pair) for pair in graph.edge_index.T.tolist()]
    assert len(pairs) == len(set(pairs))
    for k in (1, 2):
        hub = reference_node(graph, k)
        nodes = graph.part_nodes(k)
        assert graph.position[hub, 1] == graph.position[nodes, 1].max()
        for node in set(nodes.tolist()) - {hub}:
            assert (node, hub) in pairs
            assert (hub, node) in pairs


def test_reference_does_not_depend_on_the_numbering_among_equals(two_cells: TissueMesh) -> None:
    two_cells.points[1, 1] = two_cells.points[0, 1]
    assert reference_node(build_graph(two_cells), 1) == 1  # the larger x


def test_with_virtual_nodes_both_are_added_in_either_order(random_mesh) -> None:
    graph = build_graph(random_mesh(2))
    first, second = VirtualNodes()(VirtualEdges()(graph)), VirtualEdges()(VirtualNodes()(graph))
    assert first.n_edges == second.n_edges > graph.n_edges
    assert {tuple(e) for e in first.edge_index.T.tolist()} == {tuple(e) for e in second.edge_index.T.tolist()}
    assert torch.equal(first.position, second.position)
