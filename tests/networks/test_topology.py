"""The sorted adjacency."""

import numpy as np
import pytest
import torch
from torch_geometric.utils import add_self_loops

from mixpinn.base.errors import InputError
from mixpinn.graph import VirtualNodes, build_graph
from mixpinn.networks import build_topology

TRIANGLE = torch.tensor([[0, 1, 1, 2, 2, 0], [1, 0, 2, 1, 0, 2]])


def test_triangle_and_a_lone_node() -> None:
    topology = build_topology(TRIANGLE, 4, reorder=False)
    assert topology.offsets.tolist() == [0, 3, 6, 9, 10]
    assert topology.sources.tolist() == [0, 1, 2, 0, 1, 2, 0, 1, 2, 3]
    assert topology.reverse.tolist() == [0, 3, 6, 1, 4, 7, 2, 5, 8, 9]
    assert topology.loop_slot.tolist() == [0, 4, 8, 9]


@pytest.mark.parametrize("seed", range(3))
def test_invariants(random_mesh, seed: int) -> None:
    graph = VirtualNodes()(build_graph(random_mesh(seed)))
    topology = build_topology(graph.edge_index, graph.n_nodes)
    target = np.repeat(np.arange(topology.n_nodes), np.diff(topology.offsets))
    order = topology.order.numpy()
    assert sorted(order) == list(range(graph.n_nodes))
    assert np.array_equal(order[topology.position], np.arange(graph.n_nodes))
    # The reverse of a slot has its ends exchanged.
    assert np.array_equal(topology.sources[topology.reverse], target)
    assert np.array_equal(target[topology.reverse], topology.sources)
    assert np.array_equal(order[topology.sources[topology.edge_slot]], graph.edge_index[0])
    assert np.array_equal(order[target[topology.edge_slot]], graph.edge_index[1])
    assert topology.chunks[0] == 0
    assert topology.chunks[-1] == graph.n_nodes
    assert (np.diff(topology.chunks) >= 0).all()


def test_slot_features_are_those_of_pytorch_geometric(random_mesh) -> None:
    graph = build_graph(random_mesh(0))
    topology = build_topology(graph.edge_index, graph.n_nodes)
    slots = topology.slot_features(graph.edge_features)
    _, expected = add_self_loops(graph.edge_index, graph.edge_features, fill_value="mean", num_nodes=graph.n_nodes)
    torch.testing.assert_close(slots[topology.edge_slot], expected[: graph.n_edges])
    torch.testing.assert_close(slots[topology.loop_slot][topology.position], expected[graph.n_edges:])


def test_chunks_differ_by_no_more_than_a_hub(random_mesh) -> None:
    graph = VirtualNodes()(build_graph(random_mesh(0, n_points=900)))
    topology = build_topology(graph.edge_index, graph.n_nodes)
    slots = np.diff(topology.offsets[topology.chunks])
    assert np.diff(topology.offsets).max() > 100
    assert slots.max() <= topology.n_slots / len(slots) + np.diff(topology.offsets).max()


def test_neighbours_lie_closer_than_at_random(random_mesh) -> None:
    graph = build_graph(random_mesh(0, n_points=400))
    spread = {}
    for reorder in (False, True):
        topology = build_topology(graph.edge_index, graph.n_nodes, reorder=reorder)
        target = np.repeat(np.arange(topology.n_nodes), np.diff(topology.offsets))
        spread[reorder] = np.abs(target - topology.sources).mean()
    assert spread[True] < 0.6 * spread[False]


@pytest.mark.parametrize("edges", [[[0], [1]], [[0, 1, 0], [1, 0, 1]], [[0, 1, 2], [1, 0, 2]]])
def test_one_way_double_and_loop_edges_are_refused(edges: list[list[int]]) -> None:
    with pytest.raises(InputError, match="both directions"):
        build_topology(torch.tensor(edges), 3)
