"""The built-in probes as surfaces."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from mixpinn.geometry.probe_shapes import linear_probe, spherical_probe


@pytest.mark.parametrize("sizes", [{}, {"radius": 2.0, "length": 30.0, "width": 9.0, "spacing": 2.0}, {"radius": 8.0}],
                         ids=str)
def test_the_linear_probe_has_no_valleys(sizes):
    probe = linear_probe(**sizes)
    a, b, c = (probe.points[probe.triangles[:, corner]] for corner in range(3))
    hull = ConvexHull(probe.points)  # nothing else with these vertices has its volume and its area
    assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0 == pytest.approx(hull.volume, rel=1e-9)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    assert 0.5 * area.sum() == pytest.approx(hull.area, rel=1e-9)
    assert area.min() > 1e-6
    edges = np.sort(np.concatenate([probe.triangles[:, pair] for pair in ([0, 1], [1, 2], [2, 0])]), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()


def test_the_sphere_touches_the_plane_from_above():
    probe = spherical_probe(radius=10.0)
    assert probe.points[:, 1].min() == pytest.approx(0.0, abs=1e-9)
