import numpy as np
import pytest
from scipy import ndimage

from mixpinn.anatomy import VertebraShape
from mixpinn.anatomy.vertebra import paint_vertebra

SIZE = 0.5
AXES = tuple(np.arange(low, high, SIZE) + 0.5 * SIZE for low, high in ((-50, 50), (-30, 70), (-40, 40)))


def points(structure):
    index = np.argwhere(structure.mask) + structure.corner
    return np.column_stack([AXES[axis][index[:, axis]] for axis in range(3)])


@pytest.fixture(scope="module")
def vertebra():
    return paint_vertebra("v", VertebraShape(), AXES, centre=(0.0, 0.0, 0.0), tilt=0.0)


def test_outer_dimensions(vertebra):
    shape, voxels = VertebraShape(), points(vertebra)
    low, high = voxels.min(axis=0) - 0.5 * SIZE, voxels.max(axis=0) + 0.5 * SIZE
    assert high[0] - low[0] == pytest.approx(shape.transverse_span, abs=2 * SIZE)
    assert high[1] - low[1] == pytest.approx(shape.spinous_reach, abs=2 * SIZE)
    body = voxels[voxels[:, 1] < 0.0]
    assert np.ptp(body[:, 2]) + SIZE == pytest.approx(shape.body_height, abs=2 * SIZE)
    assert np.ptp(body[:, 0]) + SIZE == pytest.approx(shape.body_width, abs=2 * SIZE)


def test_one_piece_with_one_canal(vertebra):
    assert ndimage.label(vertebra.mask)[1] == 1
    # The hole of the ring: soft tissue that the vertebra encloses at the height of the pedicles and laminae.
    level = int(np.argmin(np.abs(AXES[2])))
    plane = vertebra.window((0, 0, level), (len(AXES[0]), len(AXES[1]), level + 1))[:, :, 0]
    canal = ndimage.binary_fill_holes(plane) & ~plane
    shape = VertebraShape()
    assert canal.sum() * SIZE ** 2 >= np.pi / 4 * shape.canal_width * shape.canal_depth * 0.97
    assert np.ptp(np.flatnonzero(canal.any(axis=1))) * SIZE == pytest.approx(shape.canal_width, abs=3 * SIZE)


def test_nothing_reaches_into_the_canal(vertebra):
    shape, (x, b, _) = VertebraShape(), points(vertebra).T
    middle = 0.5 * shape.body_depth + 0.5 * shape.canal_depth
    ellipse = (2.0 * x / shape.canal_width) ** 2 + (2.0 * (b - middle) / shape.canal_depth) ** 2
    assert ellipse.min() >= 1.0


def test_symmetric_about_the_sagittal_plane(vertebra):
    assert np.array_equal(vertebra.mask, vertebra.mask[::-1])


def test_volume_of_the_plain_body():
    thin = VertebraShape(
        body_waist=0.0, canal_width=20.0, pedicle_width=1e-6, pedicle_height=1e-6, lamina_thickness=1e-6,
        lamina_height=1e-6, spinous_width=1e-6, spinous_height=1e-6, transverse_thickness=1e-6,
    )
    voxels = paint_vertebra("v", thin, AXES, centre=(0.0, 0.0, 0.0), tilt=0.0).n_voxels
    exact = np.pi / 4 * thin.body_width * thin.body_depth * thin.body_height
    assert voxels * SIZE ** 3 == pytest.approx(exact, rel=0.02)


def test_tilt_turns_and_centre_moves(vertebra):
    angle = np.deg2rad(15.0)
    tilted = paint_vertebra("v", VertebraShape(), AXES, centre=(1.0, -5.0, 6.0), tilt=angle)
    turn = np.array([[1, 0, 0], [0, np.cos(angle), np.sin(angle)], [0, -np.sin(angle), np.cos(angle)]])
    expected = points(vertebra).mean(axis=0) @ turn.T + [1.0, -5.0, 6.0]
    assert np.allclose(points(tilted).mean(axis=0), expected, atol=0.1)
    assert tilted.n_voxels == pytest.approx(vertebra.n_voxels, rel=0.01)
