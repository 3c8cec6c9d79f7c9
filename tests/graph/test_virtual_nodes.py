"""Virtual nodes against the paper's five bullet points."""

import pytest
import torch

from mixpinn.base.errors import InputError
from mixpinn.graph import VirtualNodes, build_graph, node_features, node_input, virtual_targets
from mixpinn.records import TissueMesh


def test_two_cells(two_cells: TissueMesh) -> None:
    before = build_graph(two_cells)
    graph = VirtualNodes()(before)
    assert (graph.n_nodes, graph.n_mesh_nodes, graph.virtual_node_part.tolist()) == (6, 5, [1])
    centre = torch.tensor([2.0, 0.0, 1.0], dtype=torch.float64)
    torch.testing.assert_close(graph.position[5], centre)
    torch.testing.assert_close(graph.node_features[5:], node_features(centre[None], torch.tensor([1]), 1))
    added = graph.edge_index[:, graph.n_mesh_edges:]
    assert sorted(added.T.tolist()) == sorted([[0, 5], [1, 5], [4, 5], [5, 0], [5, 1], [5, 4]])
    lengths = {0: 14.0**0.5, 1: 2.0**0.5, 4: 14.0**0.5}
    for (source, target), features in zip(added.T.tolist(), graph.edge_features[graph.n_mesh_edges:], strict=True):
        assert features.tolist() == pytest.approx([lengths[min(source, target)], 1.0])
    assert torch.equal(graph.mesh_rigid_edges, before.mesh_rigid_edges)
    assert graph.rigid_edges.shape[1] == before.rigid_edges.shape[1] + 6


def test_input_is_zero_and_target_is_the_mean_of_the_part(two_cells: TissueMesh) -> None:
    graph = VirtualNodes()(build_graph(two_cells))
    field = torch.arange(30.0).view(2, 5, 3)
    x = node_input(graph, field)
    assert x.shape == (2, 6, 10)
    assert torch.equal(x[:, 5, :3], torch.zeros(2, 3))
    target = virtual_targets(graph, field)
    assert torch.equal(target[:, :5], field)
    torch.testing.assert_close(target[:, 5], (field[:, 0] + field[:, 1] + field[:, 4]) / 3.0)


def test_applied_twice_is_refused(two_cells: TissueMesh) -> None:
    graph = VirtualNodes()(build_graph(two_cells))
    with pytest.raises(InputError, match="once"):
        VirtualNodes()(graph)


def test_the_given_graph_stays_as_it_is(random_mesh) -> None:
    graph = build_graph(random_mesh(1))
    edges = graph.edge_index.clone()
    VirtualNodes()(graph)
    assert graph.n_nodes == graph.n_mesh_nodes
    assert torch.equal(graph.edge_index, edges)
