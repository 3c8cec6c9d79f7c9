"""Valleys of a probe, against angles that are known."""

import numpy as np
import pytest

from mixpinn.geometry.probe_shapes import linear_probe, spherical_probe
from mixpinn.records import Probe
from mixpinn.records.probe import check_probe
from mixpinn.records.probe_valleys import valley_warning, valleys


def roof(rise: float, *, length: float = 20.0, height: float = 30.0) -> tuple[np.ndarray, np.ndarray]:
    """A block whose face is a groove along z: two planes that meet `rise` mm above its lower edges, 10 mm apart."""
    outline = np.array([[-10.0, 0.0], [0.0, rise], [10.0, 0.0], [10.0, height], [-10.0, height]])
    points = np.array([[x, y, z] for z in (0.0, length) for x, y in outline])
    n = len(outline)
    sides = [[i, (i + 1) % n, n + (i + 1) % n, n + i] for i in range(n)]
    triangles = [t for a, b, c, d in sides for t in ((a, c, b), (a, d, c))]
    return points, np.array(triangles)


@pytest.mark.parametrize("rise", [1.0, 4.0, 10.0])
def test_a_groove_has_the_angle_of_its_planes(rise):
    points, triangles = roof(rise)
    expected = 2.0 * np.rad2deg(np.arctan2(rise, 10.0))
    for faces in (triangles, triangles[:, ::-1]):  # which side is out shows at the tip
        np.testing.assert_allclose(valleys(points, faces), [expected], atol=1e-9)


def test_ridges_and_what_lies_far_up_are_no_valleys():
    assert not len(valleys(*roof(-4.0)))
    assert not len(valleys(*roof(0.1)))  # a degree: as good as flat
    points, triangles = roof(4.0)
    tall = np.concatenate([points, [[0.0, -40.0, 0.0]]])  # the groove is 44 mm above the tip
    assert not len(valleys(tall, np.concatenate([triangles, [[0, 2, 10]]])))


def test_built_in_probes_have_none():
    for probe in (linear_probe(), linear_probe(radius=2.0, spacing=5.0), spherical_probe(radius=8.0)):
        assert valley_warning(probe.points, probe.triangles) == ""


def test_they_are_told_once_and_how_to_mend_them():
    told, = (line for line in check_probe(Probe(*roof(4.0))) if "valley" in line)
    assert "a valley between its faces, up to 44° deep" in told
    assert "convex hull" in told
    assert len(told.splitlines()) == 1
