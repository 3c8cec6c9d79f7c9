"""The stack of attention layers."""

import pytest
import torch
from torch import nn

from mixpinn.graph import build_graph
from mixpinn.networks import Backend, GATNetwork, build_topology


@pytest.mark.parametrize(("heads", "edges"), [(1, False), (2, True)])
def test_backends_agree_through_eight_layers(random_mesh, heads: int, edges: bool) -> None:
    torch.manual_seed(0)
    graph = build_graph(random_mesh(0, n_points=80))
    topology = build_topology(graph.edge_index, graph.n_nodes)
    network = GATNetwork(11, layers=8, heads=heads, hidden=8, n_edge_inputs=3 if edges else None)
    features = 0.1 * graph.edge_features if edges else None
    x = torch.randn(2, graph.n_nodes, 11)
    results = []
    for backend in (Backend.FUSED, Backend.REFERENCE):
        network.zero_grad()
        out = network.use_backend(backend)(x, topology, features)
        out.square().sum().backward()
        results.append((out.detach(), [parameter.grad.clone() for parameter in network.parameters()]))
    (ours, our_grads), (theirs, their_grads) = results
    assert ours.shape == (2, graph.n_nodes, 3)
    torch.testing.assert_close(ours, theirs, atol=1e-5, rtol=1e-5)
    # Through eight random layers nodes become alike and the gradients of early attention vectors sink into rounding:
    # the largest gradient of the network is the scale.
    scale = max(gradient.abs().max().item() for gradient in their_grads)
    for a, b in zip(our_grads, their_grads, strict=True):
        torch.testing.assert_close(a, b, atol=1e-4 * scale, rtol=0.0)


def test_widths() -> None:
    network = GATNetwork(14, layers=8, heads=2, hidden=128)
    shapes = [tuple(layer.lin.weight.shape) for layer in network.layers]
    assert shapes == [(256, 14)] + [(256, 256)] * 6 + [(6, 256)]
    assert isinstance(network.layers, nn.ModuleList)


def test_information_crosses_one_edge_a_layer() -> None:
    n = 12
    path = torch.stack([torch.arange(n - 1), torch.arange(1, n)])
    topology = build_topology(torch.cat([path, path.flip(0)], dim=1), n)
    torch.manual_seed(0)
    network = GATNetwork(4, layers=8, heads=2, hidden=8)
    x = torch.randn(1, n, 4, requires_grad=True)
    network(x, topology)[0, 0].sum().backward()
    assert (x.grad[0, 9:] == 0.0).all()
    assert (x.grad[0, :6].abs().sum(dim=1) > 0.0).all()
