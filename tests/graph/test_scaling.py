"""Scaling statistics."""

import torch

from mixpinn.graph import build_graph, identity_statistics, node_input, standard_statistics


def test_standardised_columns(random_mesh) -> None:
    graph = build_graph(random_mesh(0))
    targets = torch.randn(6, graph.n_mesh_nodes, 3) * torch.tensor([1.0, 5.0, 0.1])
    statistics = standard_statistics(graph, targets)
    x = (node_input(graph, targets) - statistics.input_shift) / statistics.input_scale
    torch.testing.assert_close(x[..., :3].square().mean(dim=(0, 1)), torch.ones(3))
    torch.testing.assert_close(x[0, :, 3:9].mean(dim=0), torch.zeros(6), atol=1e-5, rtol=0.0)
    torch.testing.assert_close(x[0, :, 3:9].std(dim=0, correction=0), torch.ones(6))
    assert torch.equal(x[0, :, 9:], graph.node_features[:, 6:])
    torch.testing.assert_close(statistics.output_scale, targets.square().mean(dim=(0, 1)).sqrt())
    length = (graph.edge_length - statistics.edge_shift[0]) / statistics.edge_scale[0]
    torch.testing.assert_close(length.std(correction=0), torch.tensor(1.0))


def test_a_component_that_never_moves_is_left_alone(random_mesh) -> None:
    graph = build_graph(random_mesh(0))
    targets = torch.randn(2, graph.n_mesh_nodes, 3)
    targets[..., 2] = 0.0
    assert standard_statistics(graph, targets).output_scale[2] == 1.0


def test_identity(random_mesh) -> None:
    graph = build_graph(random_mesh(0))
    x = node_input(graph, torch.randn(1, graph.n_mesh_nodes, 3))
    statistics = identity_statistics(graph)
    assert torch.equal((x - statistics.input_shift) / statistics.input_scale, x)
