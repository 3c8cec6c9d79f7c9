"""Meshes small enough to check by hand."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial import Delaunay

from mixpinn.records import TissueMesh


@pytest.fixture
def two_cells() -> TissueMesh:
    """Two tetrahedra that share the face 1-2-3; nodes 0, 1 and 4 are rigid part 1, where 0 and 4 are not joined.

    Node 0 has the largest y of the part.
    """
    points = np.array([[0.0, 3.0, 0.0], [3.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 3.0], [3.0, -3.0, 3.0]])
    cells = np.array([[0, 1, 2, 3], [1, 2, 3, 4]], np.int32)
    return TissueMesh(
        points, cells, np.array([1, 1, 0, 0, 1], np.int16), np.zeros(5, bool), ("A",), np.zeros(2, np.int16),
    )


@pytest.fixture
def random_mesh() -> Callable[..., TissueMesh]:
    """Delaunay mesh of random points, the nodes of the left cut in half being two rigid parts."""

    def make(seed: int, n_points: int = 40) -> TissueMesh:
        points = np.random.default_rng(seed).uniform(-10.0, 10.0, (n_points, 3))
        cells = Delaunay(points).simplices.astype(np.int32)
        part = np.where(points[:, 0] < -2.0, 1 + (points[:, 2] > 0.0), 0).astype(np.int16)
        return TissueMesh(points, cells, part, np.zeros(n_points, bool), ("A", "B"), np.zeros(len(cells), np.int16))

    return make
