"""Losses by hand, and their gradients."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mixpinn.graph import VirtualNodes, build_graph, virtual_targets
from mixpinn.networks import mean_euclidean_error, rigid_edge_change, rigid_edge_loss
from mixpinn.networks.losses import edge_length_change, safe_norm
from mixpinn.records import TissueMesh


def test_mean_euclidean_error_by_hand() -> None:
    target = torch.zeros(2, 2, 3)
    predicted = torch.tensor([[[3.0, 4.0, 0.0], [0.0, 0.0, 0.0]], [[0.0, 0.0, 1.0], [2.0, 2.0, 1.0]]])
    assert mean_euclidean_error(predicted, target).item() == pytest.approx((5.0 + 0.0 + 1.0 + 3.0) / 4.0)


def test_gradient_at_zero_error_is_zero() -> None:
    predicted = torch.zeros(1, 3, 3, requires_grad=True)
    mean_euclidean_error(predicted, torch.zeros(1, 3, 3)).backward()
    assert torch.equal(predicted.grad, torch.zeros(1, 3, 3))


def test_gradient_of_the_norm() -> None:
    vector = torch.randn(5, 3, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(safe_norm, vector)


def test_rigid_edges_by_hand(two_cells: TissueMesh) -> None:
    graph = build_graph(two_cells)
    # Rigid edges 0-1 and 1-4, both of rest length 3 √2, seen in both directions. Node 1 moves by 3 along x:
    # it is then at (6, 0, 0), √45 from node 0 at (0, 3, 0) and √27 from node 4 at (3, -3, 3).
    displacement = torch.zeros(1, 5, 3)
    displacement[0, 1, 0] = 3.0
    changes = np.array([45.0**0.5, 27.0**0.5]) - 18.0**0.5
    assert rigid_edge_loss(displacement, graph).item() == pytest.approx((changes**2).mean(), rel=1e-6)
    assert rigid_edge_change(displacement, graph).item() == pytest.approx(np.abs(changes).mean(), rel=1e-6)


def test_virtual_nodes_count_in_the_loss_and_only_on_request_in_the_error(two_cells: TissueMesh) -> None:
    graph = VirtualNodes()(build_graph(two_cells))
    displacement = torch.zeros(1, 6, 3)
    displacement[0, 5] = 1.0  # the virtual node alone moves
    lengths = np.array([14.0, 2.0, 14.0]) ** 0.5
    moved = np.linalg.norm(np.array([3.0, 1.0, 2.0]) - two_cells.points[[0, 1, 4]], axis=1)
    changes = np.concatenate([np.zeros(2), moved - lengths])
    assert rigid_edge_loss(displacement, graph).item() == pytest.approx((changes**2).mean(), rel=1e-5)
    assert rigid_edge_change(displacement[:, :5], graph).item() == 0.0
    found = rigid_edge_change(displacement, graph, virtual=True)
    assert found.item() == pytest.approx(np.abs(changes).mean(), rel=1e-6)


@settings(max_examples=25, deadline=None)
@given(
    vector=st.tuples(*[st.floats(-2.0, 2.0)] * 3), shift=st.tuples(*[st.floats(-20.0, 20.0)] * 3),
)
def test_rigid_motion_changes_no_length(vector, shift) -> None:
    points = np.random.default_rng(0).uniform(-50.0, 50.0, (6, 3))
    cells = np.array([[0, 1, 2, 3], [2, 3, 4, 5]], np.int32)
    mesh = TissueMesh(points, cells, np.ones(6, np.int16), np.zeros(6, bool), ("A",), np.zeros(2, np.int16))
    graph = VirtualNodes()(build_graph(mesh))
    moved = Rotation.from_rotvec(vector).apply(points) + np.array(shift)
    displacement = virtual_targets(graph, torch.from_numpy(moved - points)[None])
    assert rigid_edge_change(displacement, graph, virtual=True).item() < 1e-10
    assert rigid_edge_loss(displacement, graph).item() < 1e-20


def test_change_of_length_is_exact_for_tiny_displacements() -> None:
    position = torch.tensor([[0.0, 0.0, 0.0], [100.0, 0.0, 0.0]], dtype=torch.float64)
    displacement = torch.tensor([[[0.0, 0.0, 0.0], [1e-6, 0.0, 0.0]]])
    change = edge_length_change(displacement, position, torch.tensor([[0], [1]]))
    assert change.item() == pytest.approx(1e-6, rel=1e-5)


def test_without_rigid_edges_both_are_zero(two_cells: TissueMesh) -> None:
    two_cells.part[:] = 0
    graph = build_graph(two_cells)
    assert rigid_edge_loss(torch.randn(2, 5, 3), graph).item() == 0.0
    assert rigid_edge_change(torch.randn(2, 5, 3), graph).tolist() == [0.0, 0.0]
