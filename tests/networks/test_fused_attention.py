"""Fused attention: against a dense formula, finite differences, threads, extreme scores, hubs."""

import pytest
import torch
from torch import Tensor

from mixpinn.graph import VirtualNodes, build_graph
from mixpinn.networks import AttentionTopology, build_topology, fused_attention


def dense_attention(
    x: Tensor, att_src: Tensor, att_dst: Tensor, slot_score: Tensor, bias: Tensor, topology: AttentionTopology,
) -> Tensor:
    """The paper's equation with an (N, N) matrix of logits, in the precision of x."""
    source, target = topology.edges(1, x.device)
    heads, channels = att_src.shape
    batch, n_nodes, _ = x.shape
    split = x.view(batch, n_nodes, heads, channels)
    pair = (split * att_dst).sum(-1)[:, :, None] + (split * att_src).sum(-1)[:, None]
    edge = torch.zeros(n_nodes, n_nodes, heads, dtype=x.dtype).index_put((target, source), slot_score)
    absent = torch.ones(n_nodes, n_nodes, 1, dtype=torch.bool).index_put((target, source), torch.tensor(False))
    logit = torch.nn.functional.leaky_relu(pair + edge, 0.2).masked_fill(absent, -torch.inf)
    return torch.einsum("bijh,bjhc->bihc", logit.softmax(dim=2), split).flatten(2) + bias


def operands(topology: AttentionTopology, heads: int, channels: int, seed: int = 0) -> list[Tensor]:
    """Random operands of two samples."""
    generator = torch.Generator().manual_seed(seed)
    shapes = [(2, topology.n_nodes, heads * channels), (heads, channels), (heads, channels), (topology.n_slots, heads)]
    return [torch.randn(shape, generator=generator) for shape in [*shapes, (heads * channels,)]]


@pytest.mark.parametrize(("heads", "channels"), [(1, 4), (2, 6)])
def test_against_the_dense_formula_in_double_precision(random_mesh, heads: int, channels: int) -> None:
    graph = VirtualNodes()(build_graph(random_mesh(3)))
    topology = build_topology(graph.edge_index, graph.n_nodes)
    single = [value.requires_grad_() for value in operands(topology, heads, channels)]
    double = [value.detach().double().requires_grad_() for value in single]
    out = fused_attention(*single, topology, relu=True)
    expected = dense_attention(*double, topology).relu()
    torch.testing.assert_close(out.double(), expected, atol=1e-5, rtol=0.0)
    out.square().sum().backward()
    expected.square().sum().backward()
    for ours, theirs in zip(single, double, strict=True):
        scale = theirs.grad.abs().max().item()
        torch.testing.assert_close(ours.grad.double(), theirs.grad, atol=1e-4 * scale, rtol=0.0)


def test_gradient_against_finite_differences() -> None:
    path = torch.tensor([[0, 1, 1, 2], [1, 0, 2, 1]])
    topology = build_topology(path, 3)
    values = [value.requires_grad_() for value in operands(topology, 2, 3, seed=1)]
    fused_attention(*values, topology, relu=False).square().sum().backward()
    step = 1e-2
    for value in values:
        flat, gradient = value.detach().view(-1), value.grad.view(-1)
        for entry in range(0, len(flat), 3):
            start, energy = flat[entry].item(), []
            for sign in (1.0, -1.0):
                flat[entry] = start + sign * step
                out = fused_attention(*[v.detach() for v in values], topology, relu=False)
                energy.append(out.double().square().sum().item())
            flat[entry] = start
            slope = (energy[0] - energy[1]) / (2.0 * step)
            assert gradient[entry].item() == pytest.approx(slope, rel=2e-3, abs=2e-3)


def test_number_of_threads_does_not_change_a_bit(random_mesh) -> None:
    graph = VirtualNodes()(build_graph(random_mesh(0, n_points=300)))
    topology = build_topology(graph.edge_index, graph.n_nodes)
    before, results = torch.get_num_threads(), []
    try:
        for threads in (1, 2):
            torch.set_num_threads(threads)
            values = [value.requires_grad_() for value in operands(topology, 2, 8)]
            out = fused_attention(*values, topology, relu=True)
            out.backward(torch.ones_like(out))
            results.append([out.detach(), *[value.grad for value in values]])
    finally:
        torch.set_num_threads(before)
    assert all(torch.equal(a, b) for a, b in zip(*results, strict=True))


def test_large_scores_stay_finite(random_mesh) -> None:
    graph = build_graph(random_mesh(0))
    topology = build_topology(graph.edge_index, graph.n_nodes)
    values = [(1e3 * value).requires_grad_() for value in operands(topology, 2, 4)]
    out = fused_attention(*values, topology, relu=False)
    out.sum().backward()
    assert out.isfinite().all()
    assert all(value.grad.isfinite().all() for value in values)
    # A softmax is a weighted mean: no output leaves the range of its inputs.
    plain = (out - values[4]).detach()
    assert plain.max() <= values[0].max() * (1 + 1e-5)
    assert plain.min() >= values[0].min() * (1 + 1e-5)


def test_star_of_hundreds() -> None:
    leaves = torch.arange(1, 700)
    hub = torch.zeros_like(leaves)
    topology = build_topology(torch.cat([torch.stack([leaves, hub]), torch.stack([hub, leaves])], dim=1), 700)
    x = torch.randn(1, 700, 8, generator=torch.Generator().manual_seed(0))
    zero = torch.zeros(2, 4)
    out = fused_attention(x, zero, zero, None, None, topology, relu=False)
    # Without attention vectors all weights of a node are equal: the hub gets the mean of all nodes.
    torch.testing.assert_close(out[0, topology.position[0]], x[0].mean(dim=0), atol=1e-5, rtol=0.0)
