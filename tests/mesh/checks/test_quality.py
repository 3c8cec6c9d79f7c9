import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mesh.shapes import box_mesh
from mixpinn.mesh import dihedral_angles, mesh_quality, radius_ratios

REGULAR = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
CORNER = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
CELL = np.array([[0, 1, 2, 3]])


def test_regular_tetrahedron():
    assert dihedral_angles(REGULAR, CELL) == pytest.approx(np.full((1, 6), np.degrees(np.arccos(1 / 3))))
    assert radius_ratios(REGULAR, CELL) == pytest.approx([1.0])


def test_corner_of_a_cube():
    """Right angles at the three axes, acos(1/√3) at the others; r = 1/(3 + √3), R = √3/2."""
    angles = np.sort(dihedral_angles(CORNER, CELL)[0])
    assert angles == pytest.approx([np.degrees(np.arccos(1 / np.sqrt(3)))] * 3 + [90.0] * 3)
    assert radius_ratios(CORNER, CELL) == pytest.approx([3 / (3 + np.sqrt(3)) / (np.sqrt(3) / 2)])


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.1, 100.0))
def test_shape_does_not_depend_on_place_size_or_numbering(seed, scale):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(4, 3))
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turn[0] *= np.sign(np.linalg.det(turn))
    moved = scale * points @ turn.T + rng.normal(size=3)
    order = rng.permutation(4)[None]
    assert radius_ratios(moved, order) == pytest.approx(radius_ratios(points, CELL), rel=1e-6, abs=1e-9)


def test_box():
    quality = mesh_quality(box_mesh((3, 3, 3), cavity=np.s_[1:2, 1:2, 1:2]))
    assert (quality.n_points, quality.n_cells) == (64, 26 * 6)
    assert quality.min_dihedral == pytest.approx(45.0)
    assert quality.max_dihedral == pytest.approx(90.0)
    assert quality.min_volume == pytest.approx(1000.0 / 6.0)
    assert (quality.inverted, quality.slivers, quality.spanning_cells, quality.branching_edges) == (0, 0, 0, 0)
