"""One small anatomy in the many files that it may come in: the same places, or one line that says what to do."""

import nibabel as nib
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from anatomy.builders import masks, write_folder, write_nifti
from mixpinn.anatomy import read_folder, read_multilabel
from mixpinn.base.errors import InputError

SCALE = np.diag([10.0, 10.0, 10.0, 1.0])
NAMES = {1: "body_trunc", 2: "vertebrae_L1", 3: "vertebrae_L2"}


def centres(segmentation):
    return {
        part.name: (segmentation.affine @ [*part.centroid, 1.0])[:3]
        for part in (segmentation.body, *segmentation.rigid)
    }


def expected(affine=SCALE, structures=None):
    return {
        name: (affine @ [*np.argwhere(mask).mean(axis=0), 1.0])[:3]
        for name, mask in (structures or masks()).items() if mask.any()
    }


def same(found, wanted, *, atol=1e-3):
    assert found.keys() == wanted.keys()
    for name in wanted:
        np.testing.assert_allclose(found[name], wanted[name], atol=atol, err_msg=name)


def save(folder, change):
    """One file a structure, each as `change` makes it from the mask."""
    folder.mkdir()
    for name, mask in masks().items():
        nib.save(change(mask.astype(np.uint8)), folder / f"{name}.nii.gz")
    return folder


@pytest.mark.parametrize("axes", ["RAS", "LPS", "LAS", "PIR", "ASL", "SAR", "IRP"])
def test_orders_and_directions_of_axes(tmp_path, axes):
    turn = nib.orientations.ornt_transform(nib.io_orientation(SCALE), nib.orientations.axcodes2ornt(axes))
    folder = save(tmp_path / "in", lambda mask: nib.Nifti1Image(mask, SCALE).as_reoriented(turn))
    same(centres(read_folder(folder)), expected())


@pytest.mark.parametrize("kind", ["oblique", "sheared", "anisotropic"])
def test_matrices_that_are_no_plain_scale(tmp_path, kind):
    affine = SCALE.copy()
    if kind == "oblique":
        affine[:3, :3] = Rotation.from_euler("xyz", [20, -15, 30], degrees=True).as_matrix() @ SCALE[:3, :3]
    elif kind == "sheared":
        affine[1, 2] = 1.5  # a tilted gantry
    else:
        affine[:3, :3] = np.diag([8.0, 8.0, 20.0])
    folder = tmp_path / "in"
    folder.mkdir()
    for name, mask in masks().items():
        image = nib.Nifti1Image(mask.astype(np.uint8), affine)
        image.set_qform(affine, 0, strip_shears=True)
        nib.save(image, folder / f"{name}.nii.gz")
    same(centres(read_folder(folder)), expected(affine))


@pytest.mark.parametrize("dtype", ["int8", "uint16", "int32", "int64", "uint64", "float32", "float64"])
@pytest.mark.parametrize("value", [1, 100])
def test_types_and_values_of_a_mask(tmp_path, dtype, value):
    def change(mask):
        return nib.Nifti1Image((mask * value).astype(dtype), SCALE, dtype=np.dtype(dtype))

    same(centres(read_folder(save(tmp_path / "in", change))), expected())


@pytest.mark.parametrize("dtype", ["int64", "float64"])
def test_types_of_a_multi_label_image(tmp_path, dtype):
    labels = np.zeros(masks()["body_trunc"].shape)
    for number, name in NAMES.items():
        labels[masks()[name]] = number
    nib.save(nib.Nifti1Image(labels.astype(dtype), SCALE, dtype=np.dtype(dtype)), tmp_path / "labels.nii.gz")
    same(centres(read_multilabel(tmp_path / "labels.nii.gz", names=NAMES)), expected())


def test_a_fourth_axis(tmp_path):
    same(centres(read_folder(save(tmp_path / "one", lambda m: nib.Nifti1Image(m[..., None], SCALE)))), expected())
    two = save(tmp_path / "two", lambda mask: nib.Nifti1Image(np.stack([mask, mask], axis=-1), SCALE))
    with pytest.raises(InputError, match="4-D image"):
        read_folder(two)


@pytest.mark.parametrize(("qform", "sform"), [(1, 0), (3, 0), (0, 1), (0, 2), (1, 1)])
def test_either_matrix_of_the_header_is_enough(tmp_path, qform, sform):
    def change(mask):
        image = nib.Nifti1Image(mask, SCALE)
        image.set_qform(SCALE if qform else None, qform)
        image.set_sform(SCALE if sform else None, sform)
        return image

    same(centres(read_folder(save(tmp_path / "in", change))), expected())


@pytest.mark.parametrize(("name", "content", "said"), [
    ("vertebrae_L1", None, "vertebrae_L1: expected at least one voxel"),
    ("body_trunc", None, "body_trunc: expected at least one voxel"),
    ("vertebrae_L1", b"", "an empty file"),
])
def test_empty_masks_and_files(tmp_path, name, content, said):
    structures = masks()
    if content is None:
        structures[name][:] = False
    folder = write_folder(tmp_path / "in", structures, SCALE)
    if content is not None:
        (folder / f"{name}.nii.gz").write_bytes(content)
    with pytest.raises(InputError, match=said) as caught:
        read_folder(folder)
    assert len(str(caught.value).splitlines()) == 1


def test_an_empty_mask_that_nobody_asks_for_is_left_alone(tmp_path):
    structures = masks() | {"rib_left_7": np.zeros_like(masks()["body_trunc"])}
    same(centres(read_folder(write_folder(tmp_path / "in", structures, SCALE))), expected())


def test_names_of_folders_and_files_in_any_letters(tmp_path):
    folder = write_folder(tmp_path / "Müller, Jürgen (CT 2) – ß", affine=SCALE)
    same(centres(read_folder(folder)), expected())
    (folder / "body_trunc.nii.gz").rename(folder / "Körper gesamt.nii.gz")
    (folder / "vertebrae_L1.nii.gz").rename(folder / "vertebra L1.nii.gz")
    found = read_folder(folder, body="Körper gesamt")
    assert (found.body.name, found.rigid[0].name) == ("Körper gesamt", "vertebra L1")


def test_links(tmp_path):
    folder = write_folder(tmp_path / "real", affine=SCALE)
    (tmp_path / "link").symlink_to(folder)
    same(centres(read_folder(tmp_path / "link")), expected())
    (tmp_path / "links").mkdir()
    for path in folder.iterdir():
        (tmp_path / "links" / path.name).symlink_to(path)
    (tmp_path / "links" / "spleen.nii.gz").symlink_to(tmp_path / "nowhere.nii.gz")  # nobody asks for it
    same(centres(read_folder(tmp_path / "links")), expected())
    (tmp_path / "links" / "vertebrae_L3.nii.gz").symlink_to(tmp_path / "nowhere.nii.gz")
    with pytest.raises(InputError, match=r"vertebrae_L3.*a link to a file that is not there; fetch the file"):
        read_folder(tmp_path / "links")


def test_a_folder_that_cannot_be_written_is_read(tmp_path):
    folder = write_folder(tmp_path / "in", affine=SCALE)
    for path in folder.iterdir():
        path.chmod(0o444)
    folder.chmod(0o555)
    try:
        same(centres(read_folder(folder)), expected())
    finally:
        folder.chmod(0o755)


def test_fewer_and_more_vertebrae_than_usual(tmp_path):
    structures = masks()
    only = {name: structures[name] for name in ("body_trunc", "vertebrae_L2")}
    same(centres(read_folder(write_folder(tmp_path / "one", only, SCALE))), expected(structures=only))
    more = structures | {"vertebrae_L6": np.roll(structures["vertebrae_L2"], -4, axis=2)}
    found = read_folder(write_folder(tmp_path / "six", more, SCALE))
    assert {part.name for part in found.rigid} == {"vertebrae_L1", "vertebrae_L2", "vertebrae_L6"}
    with pytest.raises(InputError, match="lumbar vertebrae"):
        read_folder(write_folder(tmp_path / "none", {"body_trunc": structures["body_trunc"]}, SCALE))


def test_a_mask_of_another_resolution_is_refused_with_both(tmp_path):
    folder = write_folder(tmp_path / "in", affine=SCALE)
    finer = np.repeat(masks()["vertebrae_L1"], 2, axis=0)
    write_nifti(folder / "vertebrae_L1.nii.gz", finer, np.diag([5.0, 10.0, 10.0, 1.0]))
    with pytest.raises(InputError, match=r"5 × 10 × 10 mm along RAS instead of 10 × 10 × 10 mm along RAS"):
        read_folder(folder)
