"""PhysGNN: shape, batches, equivariance."""

import torch
from torch_geometric.nn import GraphConv, SAGEConv

from mixpinn.graph import build_graph
from mixpinn.networks import PhysGNNNetwork


def test_layers_are_those_of_the_protocol() -> None:
    network = PhysGNNNetwork(14)
    assert [type(layer) for layer in network.graph_convolutions] == [GraphConv] * 3
    assert [type(layer) for layer in network.sage_convolutions] == [SAGEConv] * 3
    assert {layer.out_channels for layer in [*network.graph_convolutions, *network.sage_convolutions]} == {112}
    assert [(layer.in_features, layer.out_features) for layer in (network.head[0], network.head[2])] == [
        (112, 63), (63, 3),
    ]
    assert network.dropout.p == 0.1


def test_batch_equals_single_samples(random_mesh) -> None:
    torch.manual_seed(0)
    graph = build_graph(random_mesh(0))
    network = PhysGNNNetwork(11, hidden=16).eval()
    x = torch.randn(3, graph.n_nodes, 11)
    together = network(x, graph.edge_index, graph.edge_length)
    assert together.shape == (3, graph.n_nodes, 3)
    apart = torch.cat([network(sample[None], graph.edge_index, graph.edge_length) for sample in x])
    torch.testing.assert_close(together, apart, atol=1e-6, rtol=1e-5)


def test_edge_lengths_matter_and_dropout_acts_in_training_only(random_mesh) -> None:
    torch.manual_seed(0)
    graph = build_graph(random_mesh(0))
    network = PhysGNNNetwork(11, hidden=16).eval()
    x = torch.randn(1, graph.n_nodes, 11)
    out = network(x, graph.edge_index, graph.edge_length)
    assert not torch.allclose(out, network(x, graph.edge_index, 2.0 * graph.edge_length))
    assert torch.equal(out, network(x, graph.edge_index, graph.edge_length))
    assert not torch.equal(network.train()(x, graph.edge_index, graph.edge_length), out)
