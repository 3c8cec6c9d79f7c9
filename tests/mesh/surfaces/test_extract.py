from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from mesh.shapes import ball_label_map
from mixpinn.base.errors import InputError
from mixpinn.mesh import SurfaceConfig, check_surfaces, extract_surfaces
from mixpinn.mesh.surfaces.extract import label_surface, signed_distance

APART = ((-14.0, 0.0, 0.0), (14.0, 0.0, 0.0))
TOUCHING = ((-11.0, 0.0, 0.0), (11.0, 0.0, 0.0))


@pytest.mark.parametrize(("spacing", "tolerance"), [((2.0, 2.0, 2.0), 0.1), ((1.5, 2.0, 3.0), 0.15)])
def test_volumes_of_balls(spacing, tolerance):
    """Smoothing shrinks a small ball, the more so the thicker the slices."""
    surfaces = extract_surfaces(ball_label_map(centres=APART, spacing=spacing))
    ball = 4.0 / 3.0 * np.pi
    assert surfaces.body.volume == pytest.approx(ball * 40.0**3, rel=0.02)
    assert [rigid.volume for rigid in surfaces.rigid] == pytest.approx([ball * 12.0**3] * 2, rel=tolerance)


def test_surfaces_are_closed_disjoint_and_inside():
    surfaces = extract_surfaces(ball_label_map(centres=TOUCHING))
    check_surfaces(surfaces)


@pytest.mark.parametrize("gap", [2.0, 4.0])
def test_gap_between_touching_parts(gap):
    first, second = extract_surfaces(ball_label_map(centres=TOUCHING), SurfaceConfig(gap=gap)).rigid
    distance, _ = cKDTree(first.points).query(second.points)
    assert gap - 0.5 <= distance.min() <= gap + 2.0


def test_gap_to_the_skin():
    surfaces = extract_surfaces(ball_label_map(centres=((27.0, 0.0, 0.0),)), SurfaceConfig(gap=3.0))
    assert surfaces.body.distance(surfaces.rigid[0].points).max() < -2.0


def test_caps_are_flat_and_at_the_end_of_the_image():
    whole = ball_label_map()
    half = replace(whole, labels=whole.labels[:, :, : whole.labels.shape[2] // 2 + 8])
    surface = extract_surfaces(half).body
    top = whole.affine[2, 3] + 2.0 * (half.labels.shape[2] - 0.5)
    assert surface.points[:, 2].max() == pytest.approx(top)
    cap = surface.points[np.abs(surface.points[:, 2] - top) < 1e-6]
    assert np.linalg.norm(cap[:, :2], axis=1).max() == pytest.approx(np.sqrt(40.0**2 - top**2), abs=2.5)


def test_islands_and_holes_are_dropped():
    label_map = ball_label_map()
    labels = label_map.labels.copy()
    labels[1, 1, 1] = 1
    centre = np.array(labels.shape) // 2
    labels[centre[0], centre[1] + 12, centre[2]] = 0
    plain, defective = (extract_surfaces(lm).body for lm in (label_map, replace(label_map, labels=labels)))
    assert defective.volume == pytest.approx(plain.volume)


def test_absent_structure():
    label_map = replace(ball_label_map(), rigid_names=("ball 1", "ghost"))
    with pytest.raises(InputError, match=r"ghost.*at least one voxel"):
        extract_surfaces(label_map)


def test_too_thin_structure():
    with pytest.raises(InputError, match="thicker than"):
        extract_surfaces(ball_label_map(centres=((-4.0, 0.0, 0.0), (4.0, 0.0, 0.0)), ball=3.0), SurfaceConfig(gap=8.0))


def test_signed_distance_of_a_half_space():
    mask = np.zeros((8, 3, 3), dtype=bool)
    mask[:4] = True
    expected = 2.0 * (np.arange(8) - 3.5)
    np.testing.assert_allclose(signed_distance(mask, np.full(3, 2.0))[:, 1, 1], expected)


def test_label_surface_encloses_the_voxels():
    label_map = ball_label_map()
    mask = label_map.labels > 0
    assert label_surface(label_map, mask, "body").volume == pytest.approx(mask.sum() * label_map.voxel_volume, rel=0.02)


def test_a_bone_that_is_no_target_may_be_too_thin():
    label_map = ball_label_map(centres=APART)
    labels = label_map.labels.copy()
    first = len(label_map.soft_names) + 1
    rod = np.argwhere(labels == first)
    labels[labels == first] = 1
    middle = rod.mean(axis=0).astype(int)
    labels[middle[0], middle[1], rod[:, 2].min():rod[:, 2].max()] = first
    thin = replace(label_map, labels=labels)
    with pytest.raises(InputError, match=thin.rigid_names[0]):
        extract_surfaces(thin)
    spared = extract_surfaces(replace(thin, target_names=thin.rigid_names[1:]))
    assert spared.rigid_names == thin.rigid_names[1:]
    with pytest.raises(InputError, match=thin.rigid_names[0]):
        extract_surfaces(replace(thin, target_names=thin.rigid_names[:1]))
