"""Node and edge features against the paper's table, by hand."""

import math

import torch

from mixpinn.graph import edge_features, node_features


def test_node_features_by_hand() -> None:
    position = torch.tensor([[0.0, 0.0, 0.0], [3.0, 4.0, 0.0], [0.0, 0.0, -2.0], [-1.0, 0.0, 0.0]])
    features = node_features(position, torch.tensor([0, 2, 1, 0]), 2)
    expected = torch.tensor([
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [3.0, 4.0, 0.0, 5.0, math.atan2(4.0, 3.0), math.pi / 2, 0.0, 1.0],
        [0.0, 0.0, -2.0, 2.0, 0.0, math.pi, 1.0, 0.0],
        [-1.0, 0.0, 0.0, 1.0, math.pi, math.pi / 2, 0.0, 0.0],
    ])
    torch.testing.assert_close(features, expected)


def test_five_parts_give_the_sizes_of_the_paper() -> None:
    position, part = torch.rand(4, 3), torch.tensor([0, 1, 5, 5])
    assert 3 + node_features(position, part, 5).shape[1] == 14
    assert edge_features(position, part, torch.tensor([[0, 2], [1, 3]]), 5).shape == (2, 6)


def test_edge_features_follow_the_both_ends_rule() -> None:
    position = torch.tensor([[0.0, 0.0, 0.0], [3.0, 4.0, 0.0], [0.0, 0.0, 1.0], [0.0, 2.0, 1.0]])
    part = torch.tensor([0, 1, 2, 2])
    features = edge_features(position, part, torch.tensor([[0, 1, 2, 3], [1, 2, 3, 2]]), 2)
    expected = torch.tensor([
        [5.0, 0.0, 0.0], [math.sqrt(9.0 + 16.0 + 1.0), 0.0, 0.0], [2.0, 0.0, 1.0], [2.0, 0.0, 1.0],
    ])
    torch.testing.assert_close(features, expected)


def test_no_rigid_part() -> None:
    assert node_features(torch.rand(3, 3), torch.zeros(3, dtype=torch.int64), 0).shape == (3, 6)
