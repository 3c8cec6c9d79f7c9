from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from anatomy.builders import full, masks, write_folder, write_nifti
from mixpinn.anatomy import read_folder, read_multilabel
from mixpinn.anatomy.images.label_image import LabelImage
from mixpinn.anatomy.images.lattice import on_lattice
from mixpinn.base.errors import InputError

LABELS = np.arange(24, dtype=np.uint8).reshape(2, 3, 4)
AFFINE = np.array([[0, 0, 2.0, 1], [-1.5, 0, 0, 2], [0, 3.0, 0, 3], [0, 0, 0, 1]])
IMAGE = LabelImage(LABELS, AFFINE)


def place(image):
    return on_lattice("b.nii", image, "a.nii", IMAGE)


def test_same_grid():
    labels, corner, notes = place(IMAGE)
    assert np.array_equal(labels, LABELS)
    assert (corner, notes) == ((0, 0, 0), ())


@pytest.mark.parametrize(("share", "said"), [(0.0005, 0), (0.1, 1), (0.19, 1)])
def test_grids_that_differ_by_rounding_are_taken(share, said):
    moved = AFFINE.copy()
    moved[0, 3] += 2.0 * share  # voxels are 2 mm along R
    labels, corner, notes = place(LabelImage(LABELS, moved))
    assert np.array_equal(labels, LABELS)
    assert corner == (0, 0, 0)
    assert len(notes) == said


@pytest.mark.parametrize("change", ["shifted", "turned", "scaled"])
def test_other_grids_are_refused(change):
    other = AFFINE.copy()
    if change == "shifted":
        other[0, 3] += 0.6  # 0.3 voxels
    elif change == "turned":
        other[:3, :3] = np.array([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1]]) @ other[:3, :3]
    else:
        other[:3, 0] *= 1.5
    with pytest.raises(InputError, match="resample"):
        place(LabelImage(LABELS, other))


def test_another_box_and_another_order_of_axes():
    step = np.eye(4)
    step[:3, 3] = [1, 0, 2]
    labels, corner, _ = place(LabelImage(LABELS[1:, :, 2:], AFFINE @ step))
    assert corner == (1, 0, 2)
    assert np.array_equal(labels, LABELS[1:, :, 2:])
    flip = np.array([[0, 1.0, 0, 0], [-1, 0, 0, 2], [0, 0, 1, 0], [0, 0, 0, 1]])  # (i, j) = (j', 2 - i')
    turned = np.ascontiguousarray(np.swapaxes(LABELS[:, ::-1], 0, 1))
    labels, corner, _ = place(LabelImage(turned, AFFINE @ flip))
    assert corner == (0, 0, 0)
    assert np.array_equal(labels, LABELS)


def test_masks_each_in_a_box_of_their_own(tmp_path):
    folder = write_folder(tmp_path / "boxes")
    whole = read_folder(folder)
    for name, low in {"vertebrae_L1": (3, 2, 10), "vertebrae_L2": (4, 4, 6)}.items():
        step = np.eye(4)
        step[:3, 3] = low
        mask = masks()[name][low[0]:9, low[1]:9, low[2]:16]
        write_nifti(folder / f"{name}.nii.gz", mask, step)
    read = read_folder(folder)
    assert read.shape == whole.shape
    for one, other in zip(read.parts, whole.parts, strict=True):
        assert np.array_equal(full(one), full(other))


def test_a_mask_that_sticks_out_of_the_first_widens_the_grid(tmp_path):
    folder = write_folder(tmp_path / "wide")
    step = np.eye(4)
    step[:3, 3] = [-2, 0, 0]
    mask = np.zeros((4, 4, 4), dtype=bool)
    mask[0] = True
    write_nifti(folder / "vertebrae_L1.nii.gz", mask, step)
    read = read_folder(folder)
    assert read.shape == (14, 11, 20)
    centre = read.affine @ [*read.rigid[0].centroid, 1.0]
    assert np.allclose(centre[:3], [-2.0, 1.5, 1.5])


def test_a_body_file_in_another_box(tmp_path):
    labels = np.where(masks()["vertebrae_L1"], 31, 0).astype(np.uint8)
    file = write_nifti(tmp_path / "total.nii.gz", labels)
    step = np.eye(4)
    step[:3, 3] = [1, 1, 0]
    body = write_nifti(tmp_path / "body.nii.gz", masks()["body_trunc"][1:, 1:], step)
    read = read_multilabel(file, body=Path(body))
    assert np.array_equal(full(replace(read.body)), masks()["body_trunc"])
