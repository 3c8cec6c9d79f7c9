"""Locally nearest pairs, against brute force over a finely sampled surface and by hand."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mixpinn.geometry.proximity import Triangulation, proximity

VALLEY = np.array([[0.0, 0, 0], [0, 0, 10], [10, 5, 0], [10, 5, 10], [-10, 5, 0], [-10, 5, 10]])
VALLEY_FACES = np.array([[0, 1, 2], [1, 3, 2], [0, 4, 1], [4, 5, 1]])


def test_a_point_over_a_valley_touches_both_sides() -> None:
    found = proximity(np.array([[0.0, 4.0, 5.0]]), VALLEY, Triangulation.build(VALLEY_FACES, 6), cutoff=5.0)
    # Distance of (0, 4) to the line through (0, 0) and (10, 5): |10 · 4| / √125.
    assert found.distance == pytest.approx([40.0 / np.sqrt(125.0)] * 2)


def test_a_point_over_a_ridge_touches_its_edge_once() -> None:
    ridge = VALLEY * [1.0, -1.0, 1.0]
    found = proximity(np.array([[0.0, 1.0, 5.0]]), ridge, Triangulation.build(VALLEY_FACES, 6), cutoff=3.0)
    assert len(found) == 1
    assert found.distance[0] == pytest.approx(1.0)


def test_a_point_over_a_peak_touches_its_vertex_once() -> None:
    peak = np.array([[0.0, 0, 0], [5, -3, 5], [-5, -3, 5], [-5, -3, -5], [5, -3, -5]])
    faces = np.array([[0, 2, 1], [0, 3, 2], [0, 4, 3], [0, 1, 4]])
    found = proximity(np.array([[0.0, 2.0, 0.0]]), peak, Triangulation.build(faces, 5), cutoff=4.0)
    assert len(found) == 1
    assert found.distance[0] == pytest.approx(2.0)
    assert found.weights[0].max() == pytest.approx(1.0)


def test_nothing_beyond_the_cutoff() -> None:
    surface = Triangulation.build(VALLEY_FACES, 6)
    assert len(proximity(np.array([[0.0, 40.0, 5.0]]), VALLEY, surface, cutoff=5.0)) == 0
    assert len(proximity(np.empty((0, 3)), VALLEY, surface, cutoff=5.0)) == 0


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000))
def test_the_nearest_pair_is_the_global_minimum(seed: int) -> None:
    rng = np.random.default_rng(seed)
    grid = np.stack(np.meshgrid(np.arange(5.0), np.arange(5.0), indexing="ij"), axis=-1).reshape(-1, 2)
    vertices = np.column_stack([grid[:, 0], rng.normal(scale=0.4, size=25), grid[:, 1]])
    index = np.arange(25).reshape(5, 5)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    point = np.array([[rng.uniform(1, 3), rng.uniform(-2, 2), rng.uniform(1, 3)]])
    found = proximity(point, vertices, Triangulation.build(faces, 25), cutoff=50.0)
    i, j = np.meshgrid(np.linspace(0, 1, 41), np.linspace(0, 1, 41))
    inside = i + j <= 1.0
    weights = np.stack([1 - i - j, i, j], axis=-1)[inside]
    cloud = (weights @ vertices[faces]).reshape(-1, 3)
    sampled = np.linalg.norm(cloud - point, axis=1).min()
    assert found.distance.min() <= sampled + 1e-12
    # Samples lie at most 1/40 of an edge (under 2 mm long) apart.
    assert found.distance.min() >= sampled - 0.05
