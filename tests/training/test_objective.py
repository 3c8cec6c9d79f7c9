"""The loss by hand, and the scaling of a fresh network."""

import numpy as np
import torch

from mixpinn.graph import Scaling
from mixpinn.networks import ModelConfig, build_graph_for
from mixpinn.records import SampleTable, TissueMesh
from mixpinn.training.objective import new_model, training_loss


def test_the_loss_is_the_mean_distance_over_all_nodes_with_the_virtual_ones(mesh: TissueMesh) -> None:
    config = ModelConfig(virtual_nodes=True)
    graph = build_graph_for(config, mesh)
    target = torch.zeros(2, graph.n_nodes, 3)
    predicted = target.clone()
    predicted[0, -1] = torch.tensor([3.0, 0.0, 4.0])  # a virtual node, 5 mm away
    loss = training_loss(config, graph, predicted, target)
    torch.testing.assert_close(loss, torch.tensor(5.0 / (2 * (125 + 2))))


def test_the_rigid_edge_loss_comes_in_with_its_weight(mesh: TissueMesh) -> None:
    graph = build_graph_for(ModelConfig(), mesh)
    # Stretching x by 10 % lengthens each rigid edge along x from 10 to 11 mm, diagonals less.
    position = graph.position.float()
    predicted = (position * torch.tensor([0.1, 0.0, 0.0]))[None]
    source, target = graph.rigid_edges
    rest = torch.linalg.vector_norm(position[source] - position[target], dim=1)
    moved = position + predicted[0]
    change = torch.linalg.vector_norm(moved[source] - moved[target], dim=1) - rest
    plain = training_loss(ModelConfig(rel_weight=0.0), graph, predicted, predicted)
    weighted = training_loss(ModelConfig(rel_weight=2.0), graph, predicted, predicted)
    assert plain == 0.0
    torch.testing.assert_close(weighted, 2.0 * change.square().mean(), rtol=1e-4, atol=0.0)


def test_a_fresh_network_follows_from_its_seed_and_is_scaled_by_the_training_samples(
    mesh: TissueMesh, table: SampleTable,
) -> None:
    config = ModelConfig(layers=2, hidden=8, scaling=Scaling.STANDARD)
    graph = build_graph_for(config, mesh)
    first, again, other = (new_model(config, graph, table, seed=seed) for seed in (1, 1, 2))
    rms = np.sqrt(np.square(table.displacement).mean(axis=(0, 1)))
    np.testing.assert_allclose(first.output_scale.numpy(), np.where(rms > 0.0, rms, 1.0), rtol=1e-5)
    weights = [torch.cat([value.flatten() for value in model.parameters()]) for model in (first, again, other)]
    assert torch.equal(weights[0], weights[1])
    assert not torch.equal(weights[0], weights[2])
