"""Whole models: graph, scaling and network together."""

import dataclasses

import numpy as np
import pytest
import torch

from mixpinn.base.errors import InputError
from mixpinn.graph import Scaling
from mixpinn.networks import ABLATION, MIXPINN, PHYSGNN, build_graph_for, build_model, mesh_output
from mixpinn.records import TissueMesh

SMALL = {**{f"row {number}": config.with_width("tiny") for number, config in ABLATION.items()}, "physgnn": PHYSGNN}


@pytest.mark.parametrize("name", SMALL)
def test_every_model_predicts_all_nodes_and_every_weight_gets_a_gradient(random_mesh, name: str) -> None:
    config = SMALL[name]
    graph = build_graph_for(config, random_mesh(0))
    model = build_model(config, graph, seed=1)
    contact = torch.randn(2, graph.n_mesh_nodes, 3)
    out = model(contact)
    assert out.shape == (2, graph.n_nodes, 3)
    assert graph.n_nodes - graph.n_mesh_nodes == (2 if config.virtual_nodes else 0)
    assert mesh_output(model, out).shape == contact.shape
    out.square().sum().backward()
    assert all(p.grad is not None and p.grad.isfinite().all() for p in model.parameters())


@pytest.mark.parametrize("row", [2, 5, 8, 10, 11])
def test_renumbering_the_nodes_renumbers_the_answer(random_mesh, row: int) -> None:
    config = ABLATION[row].with_width("tiny")
    for seed in range(3):
        mesh = random_mesh(seed)
        order = np.random.default_rng(seed).permutation(mesh.n_points)
        new_index = np.argsort(order)
        renumbered = TissueMesh(
            mesh.points[order], new_index[mesh.cells].astype(np.int32), mesh.part[order], mesh.fixed[order],
            mesh.rigid_names, mesh.tissue,
        )
        contact = torch.randn(1, mesh.n_points, 3, generator=torch.Generator().manual_seed(seed))
        first = build_model(config, build_graph_for(config, mesh), seed=0)
        second = build_model(config, build_graph_for(config, renumbered), seed=0)
        out, other = mesh_output(first, first(contact)), mesh_output(second, second(contact[:, order]))
        torch.testing.assert_close(out[:, order], other, atol=1e-4, rtol=1e-4)


def test_seed_gives_the_weights_and_leaves_the_global_generator_alone(random_mesh) -> None:
    config = MIXPINN.with_width("tiny")
    graph = build_graph_for(config, random_mesh(0))
    torch.manual_seed(5)
    expected = torch.rand(3)
    torch.manual_seed(5)
    states = [build_model(config, graph, seed=seed).state_dict() for seed in (1, 1, 2)]
    assert torch.equal(torch.rand(3), expected)
    weight = "network.layers.0.lin.weight"
    assert torch.equal(states[0][weight], states[1][weight])
    assert not torch.equal(states[0][weight], states[2][weight])


def test_scaling_travels_with_the_state(random_mesh) -> None:
    config = dataclasses.replace(MIXPINN.with_width("tiny"), scaling=Scaling.STANDARD)
    graph = build_graph_for(config, random_mesh(0))
    model, fresh = build_model(config, graph, seed=0), build_model(config, graph, seed=7)
    targets = 3.0 * torch.randn(4, graph.n_mesh_nodes, 3)
    contact = torch.randn(1, graph.n_mesh_nodes, 3)
    before = model(contact)
    model.fit_scaling(targets)
    assert not torch.allclose(model(contact), before)
    torch.testing.assert_close(model.output_scale, targets.square().mean(dim=(0, 1)).sqrt())
    fresh.load_state_dict(model.state_dict())
    assert torch.equal(fresh(contact), model(contact))


def test_without_scaling_fitting_changes_nothing(random_mesh) -> None:
    config = MIXPINN.with_width("tiny")
    graph = build_graph_for(config, random_mesh(0))
    model = build_model(config, graph)
    model.fit_scaling(torch.randn(4, graph.n_mesh_nodes, 3))
    assert torch.equal(model.output_scale, torch.ones(3))


def test_no_grad_gives_the_same_answer_and_keeps_it(random_mesh) -> None:
    config = MIXPINN.with_width("tiny")
    graph = build_graph_for(config, random_mesh(0))
    model = build_model(config, graph)
    first, second = torch.randn(2, 1, graph.n_mesh_nodes, 3)
    expected = model(first).detach()
    for context in (torch.no_grad, torch.inference_mode, torch.no_grad):
        with context():
            out = model(first)
            model(second)
        assert torch.equal(out, expected)


def test_a_field_of_another_mesh_is_refused(random_mesh) -> None:
    config = MIXPINN.with_width("tiny")
    model = build_model(config, build_graph_for(config, random_mesh(0)))
    with pytest.raises(InputError, match="contact displacement"):
        model(torch.zeros(1, 7, 3))
