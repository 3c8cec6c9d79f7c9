"""Farthest points: a line by hand, every beginning covers well, no entry twice."""

import numpy as np

from mixpinn.geometry.farthest_points import distances_between, farthest_first


def test_a_line_is_halved_again_and_again():
    points = np.stack([np.arange(9.0), np.zeros(9), np.zeros(9)], axis=1)
    order = farthest_first(distances_between(points), first=0, count=5)
    np.testing.assert_array_equal(order, [0, 8, 4, 2, 6])


def test_repeated_points_come_last_and_once_each():
    points = np.repeat(np.eye(3), 2, axis=0)
    order = farthest_first(distances_between(points), first=0, count=6)
    assert sorted(order) == list(range(6))
    assert {int(index) // 2 for index in order[:3]} == {0, 1, 2}


def test_gaps_shrink_from_beginning_to_beginning():
    points = np.random.default_rng(0).normal(size=(60, 3))
    order = farthest_first(distances_between(points), first=0, count=60)
    gaps = [np.linalg.norm(points[:, None] - points[order[:n]], axis=2).min(axis=1).max() for n in range(1, 60)]
    assert (np.diff(gaps) <= 1e-12).all()
