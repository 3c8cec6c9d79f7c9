"""The layer against PyTorch Geometric's `GATConv` with the same weights."""

import pytest
import torch
from torch import Tensor
from torch_geometric.nn import GATConv

from mixpinn.graph import VirtualNodes, build_graph
from mixpinn.networks import Backend, GraphAttention, build_topology


@pytest.mark.parametrize("backend", [Backend.FUSED, Backend.REFERENCE])
@pytest.mark.parametrize("relu", [True, False])
@pytest.mark.parametrize(
    ("heads", "channels", "concat", "edges"),
    [(1, 8, True, False), (2, 8, True, True), (2, 3, False, True), (3, 5, True, False), (1, 3, False, False)],
)
def test_equals_gatconv(random_mesh, backend, heads, channels, concat, edges, relu) -> None:
    torch.manual_seed(0)
    graph = VirtualNodes()(build_graph(random_mesh(0, n_points=60)))
    topology = build_topology(graph.edge_index, graph.n_nodes)
    oracle = GATConv(7, channels, heads=heads, concat=concat, edge_dim=3 if edges else None)
    torch.nn.init.normal_(oracle.bias)
    layer = GraphAttention(7, channels, heads=heads, concat=concat, n_edge_inputs=3 if edges else None)
    layer.load_state_dict(oracle.state_dict())
    layer.backend = backend
    features = 0.1 * graph.edge_features if edges else None
    x = torch.randn(3, graph.n_nodes, 7, requires_grad=True)
    weight = torch.randn(3, graph.n_nodes, heads * channels if concat else channels)

    def expected_of(sample: Tensor) -> Tensor:
        out = oracle(sample, graph.edge_index, features)
        return out.relu() if relu else out

    expected = torch.stack([expected_of(sample) for sample in x])
    (expected * weight).sum().backward()
    expected_grad, x.grad = x.grad, None
    slots = topology.slot_features(features) if edges else None
    out = layer(x[:, topology.order], topology, slots, relu=relu)[:, topology.position]
    (out * weight).sum().backward()
    torch.testing.assert_close(out, expected, atol=1e-5, rtol=0.0)
    torch.testing.assert_close(x.grad, expected_grad, atol=1e-4 * expected_grad.abs().max().item(), rtol=0.0)
    theirs = dict(oracle.named_parameters())
    for name, parameter in layer.named_parameters():
        scale = theirs[name].grad.abs().max().item()
        torch.testing.assert_close(parameter.grad, theirs[name].grad, atol=1e-4 * scale, rtol=0.0)


def test_double_precision_takes_the_reference(random_mesh) -> None:
    graph = build_graph(random_mesh(0))
    topology = build_topology(graph.edge_index, graph.n_nodes)
    layer = GraphAttention(4, 8, heads=2).double()
    assert layer(torch.randn(2, graph.n_nodes, 4).double(), topology).dtype == torch.float64


def test_autocast_takes_the_reference(random_mesh) -> None:
    graph = build_graph(random_mesh(0))
    topology = build_topology(graph.edge_index, graph.n_nodes)
    layer = GraphAttention(4, 8, heads=2)
    x = torch.randn(2, graph.n_nodes, 4)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        rounded = layer(x, topology)
    torch.testing.assert_close(rounded.float(), layer(x, topology), atol=5e-2, rtol=5e-2)
