import itertools

import nibabel as nib
import numpy as np
import pytest
import pyvista as pv
from hypothesis import given, settings
from hypothesis import strategies as st

from mixpinn.anatomy import crop, place_in_frame, read_folder
from mixpinn.base.errors import InputError

from .builders import SHAPE, block, full, masks, segmentation

SPACING = np.array([1.5, 2.0, 2.5])
SCANNER = np.array([[1.5, 0, 0, -31.0], [0, 2.0, 0, 4.7], [0, 0, 2.5, 12.3], [0, 0, 0, 1]])


def world_points(label_map, name):
    points = np.argwhere(label_map.mask(name)) @ label_map.affine[:3, :3].T + label_map.affine[:3, 3]
    return points[np.lexsort(np.round(points, 5).T)]


def reorder(array, order, flips):
    return np.flip(array.transpose(order), axis=flips)


def reordered(structures, order, flips):
    """The same volume stored in another order of axes, some reversed, with the affine that says so."""
    shape = np.array(SHAPE)[list(order)]
    to_old = np.zeros((4, 4))  # new index to old index
    to_old[3, 3] = 1
    for new, old in enumerate(order):
        to_old[old, new] = -1 if new in flips else 1
        to_old[old, 3] = shape[new] - 1 if new in flips else 0
    return {name: reorder(mask, order, flips) for name, mask in structures.items()}, SCANNER @ to_old


def lopsided():
    structures = masks()
    structures["body_trunc"][9:, :4] = False
    structures["vertebrae_L1"] |= block((5, 8, 12), (5, 8, 12))
    return structures


ORDERS = list(itertools.permutations(range(3)))
FLIPS = [axes for n in range(4) for axes in itertools.combinations(range(3), n)]


@settings(max_examples=48, deadline=None)
@given(order=st.sampled_from(ORDERS), flips=st.sampled_from(FLIPS), above=st.sampled_from([0.0, 3.75, 100.0]))
def test_storage_order_does_not_change_the_anatomy(order, flips, above):
    expected = place_in_frame(crop(segmentation(lopsided(), affine=SCANNER), above=above, below=5.0))
    structures, affine = reordered(lopsided(), order, flips)
    found = place_in_frame(crop(segmentation(structures, affine=affine), above=above, below=5.0))
    assert found.names == expected.names
    for name in expected.names:
        assert np.allclose(world_points(found, name), world_points(expected, name), atol=1e-6)
    assert found.hash() == expected.hash()
    assert np.allclose(found.world_to_scanner, expected.world_to_scanner)


def test_frame_by_hand():
    label_map = place_in_frame(segmentation(affine=SCANNER))
    # Body voxels 1–10, 1–9, 0–19: the centre of the box in RAS is at index (5.5, 5, 9.5).
    centre = SCANNER[:3, :3] @ [5.5, 5.0, 9.5] + SCANNER[:3, 3]
    assert np.allclose(label_map.world_to_scanner @ [0, 0, 0, 1], [*centre, 1])
    # x = R, y = −A, z = −S.
    assert np.allclose(label_map.world_to_scanner @ [1, 2, 3, 1], [*(centre + np.array([1, -2, -3])), 1])
    assert np.allclose(label_map.affine[:3, :3], np.diag(SPACING))
    # L1 has its middle at index (5.5, 5.5, 12).
    expected = np.array([0.0, -0.5 * 2.0, -2.5 * 2.5])
    assert np.allclose(world_points(label_map, "vertebrae_L1").mean(axis=0), expected)
    assert label_map.rigid_names == ("vertebrae_L1", "vertebrae_L2")
    assert label_map.soft_names == ("body_trunc",)


def test_one_voxel_of_background_all_round():
    labels = place_in_frame(segmentation(affine=SCANNER)).labels
    inner = labels[1:-1, 1:-1, 1:-1]
    assert labels.sum() == inner.sum()
    assert inner.shape == (10, 9, 20)  # no more than is needed


def test_crop_planes_by_hand():
    # Rigid parts reach from S = 12.3 + 2.5 * 5.5 = 26.05 to 12.3 + 2.5 * 13.5 = 46.05.
    cropped = crop(segmentation(affine=SCANNER), above=6.0, below=4.0)
    kept = np.flatnonzero(full(cropped.body).any(axis=(0, 1)))
    heights = 12.3 + 2.5 * np.arange(SHAPE[2])
    assert np.array_equal(kept, np.flatnonzero((heights >= 22.05) & (heights <= 52.05)))
    for part, before in zip(cropped.rigid, segmentation().rigid, strict=True):
        assert np.array_equal(full(part), full(before))


def test_crop_is_clipped_to_the_image():
    assert np.array_equal(full(crop(segmentation(affine=SCANNER)).body), masks()["body_trunc"])


def test_oblique_image_is_cropped_along_the_body_and_keeps_its_grid():
    angle = np.deg2rad(20.0)
    turn = np.eye(4)
    turn[1:3, 1:3] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    affine = turn @ SCANNER
    original = segmentation(affine=affine)
    cropped = crop(original, above=4.0, below=2.0)

    def scanner(mask):
        return np.argwhere(mask) @ affine[:3, :3].T + affine[:3, 3]

    half = 0.5 * np.abs(affine[2, :3]).sum()
    rigid = np.concatenate([scanner(full(part))[:, 2] for part in original.rigid])
    points = scanner(masks()["body_trunc"])
    inside = (points[:, 2] >= rigid.min() - half - 2.0) & (points[:, 2] <= rigid.max() + half + 4.0)
    assert 0 < inside.sum() < len(inside)
    assert np.allclose(scanner(full(cropped.body)), points[inside])

    label_map = place_in_frame(cropped)
    back = world_points(label_map, "vertebrae_L1") @ label_map.world_to_scanner[:3, :3].T
    back = back + label_map.world_to_scanner[:3, 3]
    expected = scanner(masks()["vertebrae_L1"])
    assert np.allclose(back[np.lexsort(np.round(back, 4).T)], expected[np.lexsort(np.round(expected, 4).T)], atol=1e-5)
    everything = np.argwhere(label_map.labels) @ label_map.affine[:3, :3].T + label_map.affine[:3, 3]
    assert np.allclose(everything.min(axis=0) + everything.max(axis=0), 0.0, atol=1e-5)


def test_rigid_wins_over_soft_and_soft_stays_inside_the_body():
    structures = masks() | {"muscle": block((0, 4, 12), (5, 5, 15))}
    label_map = place_in_frame(segmentation(structures, soft=("muscle",)))
    assert label_map.names == ("body_trunc", "muscle", "vertebrae_L1", "vertebrae_L2")
    assert label_map.mask("vertebrae_L1").sum() == structures["vertebrae_L1"].sum()
    expected = structures["muscle"] & structures["body_trunc"] & ~structures["vertebrae_L1"]
    assert label_map.mask("muscle").sum() == expected.sum()


def test_a_soft_tissue_that_the_body_leaves_out_is_painted():
    """Structures that share no voxel, as the labels of one image do not."""
    structures = masks()
    structures["muscle"] = block((2, 2, 4), (3, 8, 15))
    whole = place_in_frame(segmentation(structures, soft=("muscle",)))
    parted = {**structures, "body_trunc": structures["body_trunc"] & ~structures["muscle"]}
    assert np.array_equal(place_in_frame(segmentation(parted, soft=("muscle",))).labels, whole.labels)
    assert (whole.labels == 2).sum() == structures["muscle"].sum()


def test_rigid_parts_are_ordered_from_the_head_down():
    structures = dict(reversed(masks().items()))
    assert place_in_frame(segmentation(structures)).rigid_names == ("vertebrae_L1", "vertebrae_L2")


def test_saved_image_is_where_the_scanner_saw_it(tmp_path):
    label_map = place_in_frame(segmentation(affine=SCANNER))
    label_map.save(tmp_path / "labels.nii.gz")
    image = nib.load(tmp_path / "labels.nii.gz")
    points = np.argwhere(np.asarray(image.dataobj) == 2) @ image.affine[:3, :3].T + image.affine[:3, 3]
    expected = SCANNER[:3, :3] @ [5.5, 5.5, 12.0] + SCANNER[:3, 3]
    assert np.allclose(points.mean(axis=0), expected, atol=1e-4)
    assert label_map.load(tmp_path / "labels.nii.gz").hash() == label_map.hash()


def test_bad_crops():
    with pytest.raises(InputError, match="0 mm or more"):
        crop(segmentation(), above=-1.0)
    structures = masks() | {"brain": block((2, 2, 19), (3, 3, 19))}
    with pytest.raises(InputError, match="brain"):
        crop(segmentation(structures, soft=("brain",)), above=1.0, below=1.0)


def test_patient_crop_matches_the_paper_mesh(shared_data):
    label_map = place_in_frame(crop(read_folder(shared_data / "patient1")))
    bounds = np.array(pv.read(shared_data / "patient1" / "paper" / "body.vtu").bounds).reshape(3, 2)
    everything = np.argwhere(label_map.labels) @ label_map.affine[:3, :3].T + label_map.affine[:3, 3]
    extent = np.ptp(everything, axis=0) + 1.5
    assert np.allclose(extent, np.ptp(bounds, axis=1), atol=1.5)  # within one voxel
