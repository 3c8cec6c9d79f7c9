import gzip

import nibabel as nib
import numpy as np
import pytest

from mixpinn.anatomy.nifti import check_same_grid, read_label_image
from mixpinn.base.errors import InputError

from .builders import write_nifti

LABELS = np.arange(24, dtype=np.uint8).reshape(2, 3, 4)
AFFINE = np.array([[0, 0, 2.0, 1], [-1.5, 0, 0, 2], [0, 3.0, 0, 3], [0, 0, 0, 1]])


@pytest.mark.parametrize("name", ["a.nii", "a.nii.gz"])
@pytest.mark.parametrize("kind", [nib.Nifti1Image, nib.Nifti2Image])
@pytest.mark.parametrize("dtype", [np.uint8, np.int16, ">i2", np.float32, np.float64])
def test_reads_labels_and_affine(tmp_path, name, kind, dtype):
    nib.save(kind(LABELS.astype(dtype), AFFINE), tmp_path / name)
    image = read_label_image(tmp_path / name)
    assert np.array_equal(image.data, LABELS)
    assert image.data.dtype == np.uint8
    assert np.allclose(image.affine, AFFINE)


def test_trailing_axis_of_one_is_no_fourth_dimension(tmp_path):
    assert read_label_image(write_nifti(tmp_path / "a.nii", LABELS[..., None])).data.shape == (2, 3, 4)


def test_metres_become_millimetres(tmp_path):
    image = nib.Nifti1Image(LABELS, np.diag([0.001, 0.001, 0.002, 1.0]))
    image.header.set_xyzt_units("meter")
    nib.save(image, tmp_path / "a.nii")
    assert np.allclose(read_label_image(tmp_path / "a.nii").affine, np.diag([1.0, 1.0, 2.0, 1.0]))


def refuses(path, expected):
    with pytest.raises(InputError) as caught:
        read_label_image(path)
    message = str(caught.value)
    assert expected in message
    assert path.name in message
    assert "\n" not in message


def test_absent(tmp_path):
    refuses(tmp_path / "absent.nii.gz", "no such file")


def test_truncated_gzip(tmp_path):
    path = write_nifti(tmp_path / "a.nii.gz", np.random.default_rng(0).integers(0, 9, (20, 20, 20)).astype(np.uint8))
    path.write_bytes(path.read_bytes()[:-400])
    refuses(path, "damaged")


def test_flipped_bit_is_found_by_the_checksum(tmp_path):
    path = write_nifti(tmp_path / "a.nii.gz", np.random.default_rng(0).integers(0, 9, (20, 20, 20)).astype(np.uint8))
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(bytes(content))
    refuses(path, "damaged")


def test_truncated_before_compression(tmp_path):
    path = write_nifti(tmp_path / "a.nii", LABELS)
    content = path.read_bytes()[:-5]
    path.write_bytes(content)
    refuses(path, "damaged")
    (tmp_path / "b.nii.gz").write_bytes(gzip.compress(content))
    refuses(tmp_path / "b.nii.gz", "damaged")


@pytest.mark.parametrize("content", [b"", b"no image at all", bytes(2000), gzip.compress(b"text", mtime=0)])
def test_not_a_nifti(tmp_path, content):
    (tmp_path / "a.nii.gz").write_bytes(content)
    refuses(tmp_path / "a.nii.gz", "another kind of file")


def test_four_dimensions(tmp_path):
    refuses(write_nifti(tmp_path / "a.nii", np.zeros((2, 3, 4, 2), dtype=np.uint8)), "4-D")


def test_singular_affine(tmp_path):
    affine = np.eye(4)
    affine[:3, 2] = affine[:3, 1]
    image = nib.Nifti1Image(LABELS, None)
    image.header.set_sform(affine, code=1)
    nib.save(image, tmp_path / "a.nii")
    refuses(tmp_path / "a.nii", "singular")


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_affine_not_finite(tmp_path, value):
    path = write_nifti(tmp_path / "a.nii", LABELS)
    content = bytearray(path.read_bytes())
    content[280:284] = np.float32(value).tobytes()  # first entry of the header's sform
    path.write_bytes(bytes(content))
    refuses(path, "finite affine")


def test_no_affine_at_all(tmp_path):
    nib.save(nib.Nifti1Image(LABELS, None), tmp_path / "a.nii")
    refuses(tmp_path / "a.nii", "sform or qform")


@pytest.mark.parametrize(("data", "expected"), [
    (np.array([0.0, 0.5], dtype=np.float32), "continuous"),
    (np.array([0.0, np.nan], dtype=np.float32), "NaN"),
    (np.array([-1024, 300], dtype=np.int16), "-1024"),
    (np.array([0, 100000], dtype=np.int32), "100000"),
    (np.array([0, 1j], dtype=np.complex64), "complex64"),
])
def test_not_a_label_map(tmp_path, data, expected):
    refuses(write_nifti(tmp_path / "a.nii", data.reshape(2, 1, 1)), expected)


def test_same_grid(tmp_path):
    first = read_label_image(write_nifti(tmp_path / "a.nii", LABELS, AFFINE))
    check_same_grid("a", first, "a", first)
    shifted = AFFINE.copy()
    shifted[0, 3] += 0.1
    for other in (
        read_label_image(write_nifti(tmp_path / "b.nii", LABELS, shifted)),
        read_label_image(write_nifti(tmp_path / "b.nii", LABELS[:1], AFFINE)),
    ):
        with pytest.raises(InputError, match="resample"):
            check_same_grid("b.nii", other, "a.nii", first)
