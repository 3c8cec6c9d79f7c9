"""Drawn contacts against the closed form of a bed of springs."""

import numpy as np
import pytest

from mixpinn.reduced.load_states import Footprints, draw_loads
from validation.kuhn import grid_points

SPRING = 0.5
"""Compliance of each spring [mm/N]."""


@pytest.fixture
def bed():
    """A flat skin of 21 × 21 points, 4 mm apart, each on a spring of its own."""
    points = grid_points(np.arange(0.0, 84.0, 4.0), np.zeros(1), np.arange(0.0, 84.0, 4.0))
    return points, SPRING * np.eye(3 * len(points))


def test_forces_are_those_that_bring_the_springs_into_a_plane(bed):
    points, own = bed
    shapes = Footprints(depth=(2.0, 3.0), tilt=0.0, drag=0.0)
    for load in draw_loads(points, own, 20, shapes).reshape(20, -1, 3):
        held = load[:, 1] != 0.0
        assert held.any()
        assert not load[:, [0, 2]].any()
        depth = -SPRING * load[held, 1]  # force times compliance is how far a point went
        np.testing.assert_allclose(depth, depth[0], rtol=1e-5)
        assert 2.0 <= depth[0] <= 3.0
        reach = points[held].max(axis=0) - points[held].min(axis=0)
        assert np.hypot(reach[0], reach[2]) <= 2.0 * np.hypot(shapes.length[1], shapes.width[1])


def test_drag_stays_within_its_share_and_nothing_pulls(bed):
    points, own = bed
    loads = draw_loads(points, own, 50, Footprints(tilt=0.3, drag=0.3)).reshape(50, -1, 3)
    assert (loads[:, :, 1] <= 0.0).all()
    along = np.abs(loads[:, :, [0, 2]])
    assert (along <= 0.3 * np.abs(loads[:, :, 1:2]) * (1.0 + 1e-5)).all()
    assert along.max() > 0.0


def test_same_seed_same_loads(bed):
    points, own = bed
    first, again, other = (draw_loads(points, own, 3, Footprints(seed=seed)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()
