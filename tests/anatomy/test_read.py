import json

import numpy as np
import pytest

from mixpinn.anatomy import read_folder, read_multilabel
from mixpinn.base.errors import InputError

from .builders import SHAPE, block, full, masks, write_folder, write_nifti

AFFINE = np.array([[-1.5, 0, 0, 10], [0, 2.0, 0, -7], [0, 0, 3.0, 5], [0, 0, 0, 1]])


def multilabel(**extra):
    """The example with TotalSegmentator's numbers: L1 = 31, L2 = 30; no body."""
    labels = np.zeros(SHAPE, dtype=np.uint8)
    labels[masks()["vertebrae_L1"]], labels[masks()["vertebrae_L2"]] = 31, 30
    for number, mask in extra.items():
        labels[mask & (labels == 0)] = int(number.removeprefix("n"))
    return labels


def test_folder(tmp_path):
    write_folder(tmp_path, masks() | {"liver": block((2, 2, 2), (3, 3, 3))}, AFFINE)
    (tmp_path / "notes.txt").write_text("not an image")
    read = read_folder(tmp_path)
    assert read.body.name == "body_trunc"
    assert [part.name for part in read.rigid] == ["vertebrae_L1", "vertebrae_L2"]
    assert read.soft == ()
    assert np.allclose(read.affine, AFFINE)
    for structure in (read.body, *read.rigid):
        assert np.array_equal(full(structure), masks()[structure.name])


def test_folder_with_other_roles(tmp_path):
    write_folder(tmp_path, masks() | {"liver": block((2, 2, 2), (3, 3, 3))})
    read = read_folder(tmp_path, rigid=["vertebrae_L2"], soft=["liver", "vertebrae_L1"])
    assert [part.name for part in read.rigid] == ["vertebrae_L2"]
    assert [part.name for part in read.soft] == ["liver", "vertebrae_L1"]


def test_body_from_elsewhere(tmp_path):
    structures = masks()
    body = write_nifti(tmp_path / "skin.nii.gz", structures.pop("body_trunc"))
    folder = write_folder(tmp_path / "parts", structures)
    assert read_folder(folder, body=body).body.n_voxels == masks()["body_trunc"].sum()


def test_masks_may_hold_any_one_value(tmp_path):
    structures = {name: mask.astype(np.uint8) * 255 for name, mask in masks().items()}
    assert np.array_equal(full(read_folder(write_folder(tmp_path, structures)).body), masks()["body_trunc"])


def refuses(expected, function, *args, **kwargs):
    with pytest.raises(InputError) as caught:
        function(*args, **kwargs)
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)


def test_bad_files_in_a_folder(tmp_path):
    structures = masks()
    empty = structures | {"vertebrae_L1": np.zeros(SHAPE, dtype=bool)}
    refuses("at least one voxel", read_folder, write_folder(tmp_path / "empty", empty))
    folder = write_folder(tmp_path / "grids")
    write_nifti(folder / "vertebrae_L1.nii.gz", structures["vertebrae_L1"], AFFINE)
    refuses("resample", read_folder, folder)
    shifted = np.eye(4)
    shifted[0, 3] = 0.4
    write_nifti(folder / "vertebrae_L1.nii.gz", structures["vertebrae_L1"], shifted)
    refuses("resample", read_folder, folder)
    write_nifti(folder / "vertebrae_L1.nii.gz", multilabel())
    refuses("several labels", read_folder, folder)


def test_multilabel_with_a_body_file(tmp_path):
    file = write_nifti(tmp_path / "total.nii.gz", multilabel(n5=block((2, 2, 2), (3, 3, 3))), AFFINE)
    body = write_nifti(tmp_path / "body.nii.gz", masks()["body_trunc"], AFFINE)
    read = read_multilabel(file, body=body, soft=["liver"])
    assert {part.name for part in read.rigid} == {"vertebrae_L1", "vertebrae_L2"}
    for structure in read.rigid:
        assert np.array_equal(full(structure), masks()[structure.name])
    assert np.array_equal(full(read.body), masks()["body_trunc"])
    assert read.soft[0].n_voxels == 8


def test_trunk_of_a_two_label_body_file(tmp_path):
    file = write_nifti(tmp_path / "total.nii.gz", multilabel())
    labels = masks()["body_trunc"].astype(np.uint8)
    labels[0] = 2  # the extremities
    body = write_nifti(tmp_path / "body.nii.gz", labels)
    assert np.array_equal(full(read_multilabel(file, body=body).body), masks()["body_trunc"])


def test_multilabel_with_the_body_in_it_includes_what_lies_inside(tmp_path):
    labels = multilabel(n1=masks()["body_trunc"])
    labels[0, 0, 0] = 2
    names = {1: "body", 2: "body_extremities", 30: "vertebrae_L2", 31: "vertebrae_L1"}
    table = tmp_path / "names.json"
    table.write_text(json.dumps(names))
    file = write_nifti(tmp_path / "all.nii.gz", labels)
    for read in (read_multilabel(file, names=names), read_multilabel(file, names=table)):
        assert np.array_equal(full(read.body), masks()["body_trunc"])


def test_bad_multilabel(tmp_path):
    file = write_nifti(tmp_path / "total.nii.gz", multilabel())
    body = write_nifti(tmp_path / "body.nii.gz", masks()["body_trunc"])
    refuses("body", read_multilabel, file)
    refuses("label 30", read_multilabel, file, body=body, names={31: "vertebrae_L1"})
    refuses("did you mean vertebrae_L1", read_multilabel, file, body=body, rigid=["vertebra_L1"])
    refuses("at least one voxel", read_multilabel, file, body=body, rigid=["vertebrae_L3"])
    refuses("lumbar", read_multilabel, file, body=body, names={30: "a", 31: "b"})
    refuses("a name that is not there", read_multilabel, file, body="absent.nii.gz")
    write_nifti(body, masks()["body_trunc"], AFFINE)
    refuses("resample", read_multilabel, file, body=body)
    write_nifti(body, multilabel())
    refuses("several labels", read_multilabel, file, body=body)
