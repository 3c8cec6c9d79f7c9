"""Layers of fat and muscle: windows of HU, the thickness that survives, volumes, bones left alone."""

from pathlib import Path

import nibabel as nib
import numpy as np
import pytest

from mixpinn.anatomy.layers import FAT_HU, MUSCLE_HU, add_layers, layers_of_ct, split_layers
from mixpinn.anatomy.names import TOTAL_CLASSES, tissue_group
from mixpinn.anatomy.segmentation import Segmentation, Structure
from mixpinn.anatomy.select import with_layers
from mixpinn.base.errors import InputError
from mixpinn.fem.material.tissue_presets import MODULI, TissuePreset, preset_modulus

SHAPE = (40, 40, 30)


def slab(low: int, high: int) -> np.ndarray:
    """Across the second axis."""
    mask = np.zeros(SHAPE, dtype=bool)
    mask[2:38, low:high, :] = True
    return mask


def body(soft=()) -> Segmentation:
    """A block 36 × 36 × 30 of 2 mm with a bone inside."""
    bone = np.zeros(SHAPE, dtype=bool)
    bone[15:25, 18:28, 8:22] = True
    return Segmentation(
        Structure.trim("body", slab(2, 38)), tuple(soft), (Structure.trim("vertebrae_L1", bone),),
        np.diag([2.0, 2.0, 2.0, 1.0]), SHAPE,
    )


def ct(tmp_path, hounsfield: np.ndarray, affine=None) -> str:
    path = tmp_path / "ct.nii.gz"
    grid = np.diag([2.0, 2.0, 2.0, 1.0]) if affine is None else affine
    nib.save(nib.Nifti1Image(hounsfield.astype(np.int16), grid), path)
    return str(path)


def layered_ct() -> np.ndarray:
    """Air, 16 mm of fat at the back, muscle before it, bone."""
    hounsfield = np.full(SHAPE, -1000.0)
    hounsfield[slab(2, 38)] = 60.0
    hounsfield[slab(30, 38)] = -100.0
    hounsfield[body().rigid[0].window((0, 0, 0), SHAPE)] = 400.0
    return hounsfield


def test_windows_do_not_overlap() -> None:
    assert FAT_HU[0] < FAT_HU[1] < MUSCLE_HU[0] < MUSCLE_HU[1]


def test_fat_and_muscle_come_from_the_ct(tmp_path) -> None:
    found = layers_of_ct(body(), ct(tmp_path, layered_ct()))
    fat, muscle = (part.window((0, 0, 0), SHAPE) for part in found.soft)
    assert [part.name for part in found.soft] == ["fat", "muscle"]
    interior = np.zeros(SHAPE, dtype=bool)
    interior[5:35, 5:35, 3:27] = True
    bone = body().rigid[0].window((0, 0, 0), SHAPE)
    np.testing.assert_array_equal(fat[interior], slab(30, 38)[interior])
    near = np.zeros(SHAPE, dtype=bool)
    near[13:27, 16:30, 6:24] = True
    np.testing.assert_array_equal(muscle[interior & ~near], (slab(2, 30) & ~bone)[interior & ~near])
    assert not (fat | muscle)[bone].any()
    assert "litres" in next(str(note) for note in found.notes if note.structure == "fat")


def test_the_grid_of_the_ct_may_differ(tmp_path) -> None:
    coarse = np.kron(layered_ct(), np.ones((1, 1, 1)))[:, :, ::-1]
    affine = np.diag([2.0, 2.0, -2.0, 1.0])
    affine[2, 3] = 2.0 * (SHAPE[2] - 1)
    plain = layers_of_ct(body(), ct(tmp_path, layered_ct()))
    turned = layers_of_ct(body(), ct(tmp_path, coarse, affine))
    for one, other in zip(plain.soft, turned.soft, strict=True):
        np.testing.assert_array_equal(one.window((0, 0, 0), SHAPE), other.window((0, 0, 0), SHAPE))


def test_the_ct_lies_where_its_header_says(tmp_path) -> None:
    """In metres as in millimetres; not where a header says nothing, two things, or no place at all."""
    plain = layers_of_ct(body(), ct(tmp_path, layered_ct()))
    grid, hounsfield = np.diag([2.0, 2.0, 2.0, 1.0]), layered_ct().astype(np.int16)
    image = nib.Nifti1Image(hounsfield, np.diag([0.002, 0.002, 0.002, 1.0]))
    image.header.set_xyzt_units("meter")
    nib.save(image, tmp_path / "metres.nii.gz")
    for one, other in zip(plain.soft, layers_of_ct(body(), tmp_path / "metres.nii.gz").soft, strict=True):
        np.testing.assert_array_equal(one.window((0, 0, 0), SHAPE), other.window((0, 0, 0), SHAPE))
    mirrored, nowhere, lost = (nib.Nifti1Image(hounsfield, grid) for _ in range(3))
    mirrored.set_qform(np.diag([-2.0, 2.0, 2.0, 1.0]), code=1)
    wrong = {"handedness": mirrored, "left and right are unknown": nowhere, "finite affine": lost}
    for says, image in wrong.items():
        nib.save(image, tmp_path / "wrong.nii")
        content = bytearray((tmp_path / "wrong.nii").read_bytes())
        if image is nowhere:
            content[252:256] = bytes(4)  # the codes of qform and sform
        if image is lost:
            content[280:284] = np.float32(np.nan).tobytes()
        (tmp_path / "wrong.nii").write_bytes(content)
        with pytest.raises(InputError, match=says):
            layers_of_ct(body(), tmp_path / "wrong.nii")


@pytest.mark.parametrize(("voxels", "kept"), [(1, False), (2, False), (4, True), (6, True)])
def test_layers_survive_from_a_thickness_on(voxels, kept) -> None:
    """6 mm are asked for, voxels of 2 mm: the share of a slab of thickness t is erf(t / 2√2σ) in its middle."""
    sheet = Structure.trim("subcutaneous_fat", slab(12, 12 + voxels))
    found = add_layers(body(), (sheet,), thinnest=6.0)
    assert bool(found.soft) is kept
    if kept:
        middle = found.soft[0].window((0, 0, 0), SHAPE)[20, :, 5]
        assert abs(int(middle.sum()) - voxels) <= 1


def test_layers_are_told_from_other_tissues() -> None:
    liver, fat = Structure.trim("liver", slab(3, 9)), Structure.trim("subcutaneous_fat", slab(30, 38))
    rest, layers = split_layers(body((liver, fat)))
    assert rest.soft == (liver,)
    assert layers == (fat,)
    laid = add_layers(rest, layers)
    assert not (laid.soft[1].window((0, 0, 0), SHAPE) & liver.window((0, 0, 0), SHAPE)).any()


def test_names_of_tissues() -> None:
    groups = {name: tissue_group(name) for name in TOTAL_CLASSES.values()}
    assert groups["autochthon_left"] == groups["gluteus_medius_right"] == tissue_group("skeletal_muscle") == "muscle"
    assert tissue_group("subcutaneous_fat") == tissue_group("torso_fat") == "fat"
    assert groups["liver"] == groups["kidney_left"] == "organ"
    assert tissue_group("intervertebral_discs") == "disc"
    assert {groups[name] for name in ("vertebrae_L1", "aorta", "heart", "hip_left")} == {None}
    names = ["subcutaneous_fat", "skeletal_muscle", "autochthon_left", "liver"]
    assert with_layers((), names) == ("skeletal_muscle", "subcutaneous_fat")
    assert with_layers(("liver",), ["autochthon_left", "liver"]) == ("liver", "autochthon_left")


def test_what_is_no_ct_is_refused(tmp_path) -> None:
    with pytest.raises(InputError, match="HU"):
        layers_of_ct(body(), ct(tmp_path, slab(2, 38).astype(float)))
    with pytest.raises(InputError, match="covers the body"):
        layers_of_ct(body(), ct(tmp_path, layered_ct()[:, :20]))
    with pytest.raises(InputError, match="a CT"):
        layers_of_ct(body(), str(tmp_path / "absent.nii.gz"))


def test_a_ct_whose_checksum_does_not_fit_is_refused(tmp_path) -> None:
    path = Path(ct(tmp_path, layered_ct()))
    content = bytearray(path.read_bytes())
    content[-8] ^= 1  # the checksum of gzip, which nibabel passes over
    path.write_bytes(bytes(content))
    with pytest.raises(InputError, match="damaged") as caught:
        layers_of_ct(body(), str(path))
    assert "\n" not in str(caught.value)


def test_an_analyze_image_is_no_ct(tmp_path) -> None:
    nib.AnalyzeImage(layered_ct().astype(np.int16), np.eye(4)).to_filename(tmp_path / "ct.img")
    with pytest.raises(InputError, match="does not say left from right"):
        layers_of_ct(body(), str(tmp_path / "ct.img"))


def test_presets_lie_in_their_ranges_and_name_their_source() -> None:
    for moduli in MODULI.values():
        for entry in moduli.values():
            assert entry.low <= entry.value <= entry.high
            assert "abstract" in entry.source or "table was read" in entry.source
    assert preset_modulus("body_trunc", "compression") is None
    assert preset_modulus("torso_fat", TissuePreset.COMPRESSION).value == 26.1
    assert preset_modulus("torso_fat", "none") is None
