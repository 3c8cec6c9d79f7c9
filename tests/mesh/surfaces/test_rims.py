import numpy as np
import pytest

from mesh.shapes import ball_label_map
from mixpinn.mesh import Surface
from mixpinn.mesh.surfaces.extract import extract_surfaces
from mixpinn.mesh.surfaces.rims import cap_rims
from mixpinn.records import LabelMap
from mixpinn.records.label_map import SCANNER_TO_WORLD


def cylinder(radius=40.0, half=30.0, voxel=2.0):
    """A cylinder of tissue along z as a label map, one voxel of background round it."""
    n = int(radius / voxel) + 3
    axis = voxel * np.arange(-n, n + 1)
    disc = np.hypot(*np.meshgrid(axis, axis, indexing="ij")) <= radius
    layers = int(2 * half / voxel)
    labels = np.repeat(disc[:, :, None], layers + 2, axis=2).astype(np.uint8)
    labels[:, :, [0, -1]] = 0
    affine = np.diag([voxel, voxel, voxel, 1.0])
    affine[:3, 3] = [-n * voxel, -n * voxel, -half - voxel / 2.0]
    return LabelMap(labels, affine, np.linalg.inv(SCANNER_TO_WORLD), ("body",), ())


def test_rims_of_a_cylinder():
    """Two circles at the ends, of the cylinder's radius though marching cubes bevels the edge."""
    low, high = cap_rims(extract_surfaces(cylinder()).body, spacing=10.0)
    assert low[:, 2] == pytest.approx(-30.0)
    assert high[:, 2] == pytest.approx(30.0)
    for rim in (low, high):
        assert np.hypot(rim[:, 0], rim[:, 1]) == pytest.approx(40.0, abs=1.0)
        gaps = np.linalg.norm(rim - np.roll(rim, 1, axis=0), axis=1)
        assert gaps == pytest.approx(2.0 * np.pi * 40.0 / len(rim), rel=0.1)
        assert 9.0 < gaps.mean() < 11.0


def test_a_round_end_has_no_rim():
    assert cap_rims(extract_surfaces(ball_label_map()).body, spacing=5.0) == ()


def test_a_rim_too_short_for_its_spacing_is_left_out():
    assert cap_rims(extract_surfaces(cylinder(radius=8.0)).body, spacing=20.0) == ()


def test_sharp_surfaces_of_a_file():
    corner = np.array([[x, y, z] for x in (-50.0, 50) for y in (-40.0, 40) for z in (-30.0, 30)])
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    triangles = np.array([[q[0], q[i], q[i + 1]] for q in quads for i in (1, 2)])
    box = Surface("box", corner, triangles)
    rims = cap_rims(box, spacing=12.0)
    assert len(rims) == 2
    for rim in rims:
        on_side = np.isclose(np.abs(rim[:, 0]), 50.0) | np.isclose(np.abs(rim[:, 1]), 40.0)
        assert on_side.all()
