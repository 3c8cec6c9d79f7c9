"""Which bones are rigid parts: names, target, what the crop leaves, a sacrum in two labels."""

from dataclasses import replace

import numpy as np
import pytest

from mixpinn.anatomy import crop, place_in_frame
from mixpinn.anatomy.bones import choose_bones, one_sacrum
from mixpinn.anatomy.names import TOTAL_CLASSES, is_bone
from mixpinn.anatomy.segmentation import Segmentation, Structure
from mixpinn.base.errors import InputError

SHAPE = (40, 40, 120)


def box(low, high) -> np.ndarray:
    mask = np.zeros(SHAPE, dtype=bool)
    mask[tuple(slice(a, b) for a, b in zip(low, high, strict=True))] = True
    return mask


BOXES = {
    "vertebrae_T12": box((12, 20, 100), (28, 34, 112)), "vertebrae_L1": box((12, 20, 80), (28, 34, 95)),
    "vertebrae_L2": box((12, 20, 60), (28, 34, 75)), "sacrum": box((12, 20, 4), (28, 34, 40)),
    "vertebrae_S1": box((12, 20, 40), (28, 34, 55)), "hip_left": box((30, 10, 0), (38, 30, 30)),
    "rib_left_12": box((30, 22, 118), (38, 30, 120)),
}


def segmentation(names=tuple(BOXES), targets=("vertebrae_L1", "vertebrae_L2")) -> Segmentation:
    """Voxels of 2 mm, the last axis towards the head."""
    affine = np.diag([2.0, 2.0, 2.0, 1.0])
    body = Structure.trim("body", box((2, 2, 0), (40, 38, 120)))
    return Segmentation(
        body, (), tuple(Structure.trim(name, BOXES[name]) for name in names), affine, SHAPE, targets=targets,
    )


def test_bones_of_totalsegmentator_by_name() -> None:
    bones = {name for name in TOTAL_CLASSES.values() if is_bone(name)}
    assert {"sacrum", "vertebrae_S1", "vertebrae_T3", "hip_right", "rib_left_12", "femur_left", "sternum"} <= bones
    assert len(bones) == 62  # 25 vertebrae, sacrum, 24 ribs, sternum, skull, and five pairs
    assert not bones & {"costal_cartilages", "autochthon_left", "iliopsoas_right", "spinal_cord", "liver"}


def test_every_bone_is_rigid_and_the_lumbar_spine_is_the_target() -> None:
    names = ["liver", *BOXES]
    every, target = choose_bones(names, rigid=None, target=None, lumbar_only=False, where="here")
    assert every == tuple(BOXES)
    assert target == ("vertebrae_L1", "vertebrae_L2")
    paper, target = choose_bones(names, rigid=None, target=None, lumbar_only=True, where="here")
    assert paper == target == ("vertebrae_L1", "vertebrae_L2")
    narrow, target = choose_bones(names, rigid=["sacrum", "hip_left"], target=None, lumbar_only=False, where="here")
    assert narrow == target == ("sacrum", "hip_left")
    _, target = choose_bones(names, rigid=None, target=["sacrum"], lumbar_only=False, where="here")
    assert target == ("sacrum",)
    with pytest.raises(InputError, match="lumbar"):
        choose_bones(["liver", "hip_left"], rigid=None, target=None, lumbar_only=False, where="here")
    with pytest.raises(InputError, match="one of the rigid parts"):
        choose_bones(names, rigid=None, target=["femur_left"], lumbar_only=False, where="here")


def test_the_crop_follows_the_target_and_says_what_becomes_of_each_bone() -> None:
    cropped = crop(segmentation(), above=30.0, below=60.0)  # voxels 30 to 109 of the last axis
    kept = {part.name: part for part in cropped.rigid}
    assert set(kept) == {"vertebrae_T12", "vertebrae_L1", "vertebrae_L2", "sacrum", "vertebrae_S1"}
    assert set(cropped.cut) == {"vertebrae_T12", "sacrum"}
    assert kept["vertebrae_T12"].n_voxels == 16 * 14 * 10
    told = {note.structure: note.detail for note in cropped.notes}
    assert set(told) == set(BOXES)
    assert "outside" in told["hip_left"]
    assert "left out" in told["rib_left_12"]
    assert told["vertebrae_S1"] == "rigid: a bone inside the crop"
    assert "held" in told["vertebrae_T12"]
    top = segmentation()
    top = replace(top, rigid=tuple(part for part in top.rigid if part.name != "sacrum"))
    (note,) = (note for note in crop(top, above=30.0, below=60.0).notes if note.structure == "vertebrae_S1")
    assert "top of a sacrum that is not among the maps" in note.detail
    assert note.lasting
    again = crop(cropped, above=30.0, below=60.0)
    assert again.cut == cropped.cut
    assert again.notes == cropped.notes
    label_map = place_in_frame(cropped)
    assert set(label_map.cut_names) == {"vertebrae_T12", "sacrum"}
    assert label_map.target_names == ("vertebrae_L1", "vertebrae_L2")


def test_too_little_of_a_bone_is_soft_tissue() -> None:
    cropped = crop(segmentation(), above=16.0, below=4.0)  # four voxels of T12
    assert "vertebrae_T12" not in {part.name for part in cropped.rigid}
    assert any(note.structure == "vertebrae_T12" and "soft tissue: only" in note.detail for note in cropped.notes)


def test_a_sacrum_in_two_labels_is_one_bone() -> None:
    whole = one_sacrum(segmentation())
    names = [part.name for part in whole.rigid]
    assert "vertebrae_S1" not in names
    part = whole.rigid[names.index("sacrum")]
    assert part.n_voxels == BOXES["sacrum"].sum() + BOXES["vertebrae_S1"].sum()
    assert one_sacrum(segmentation(("vertebrae_L1", "sacrum"))).notes == ()


def test_targets_alone_leave_no_notes(tmp_path) -> None:
    cropped = crop(segmentation(("vertebrae_L1", "vertebrae_L2")), above=10.0, below=10.0)
    assert cropped.notes == cropped.cut == ()
    label_map = place_in_frame(cropped)
    label_map.save(tmp_path / "labels.nii.gz")
    again = type(label_map).load(tmp_path / "labels.nii.gz")
    assert again.target_names == label_map.target_names
    assert again.hash() == label_map.hash()
