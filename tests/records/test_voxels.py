import gzip

import nibabel as nib
import numpy as np
import pytest

from mixpinn.base.errors import InputError
from mixpinn.records.voxels import MOST_VOXELS, check_extents, nifti_claim, nifti_content, nifti_head, read_labels

LABELS = np.arange(60, dtype=np.uint8).reshape(3, 4, 5)


@pytest.fixture(params=["l.nii", "l.nii.gz"])
def path(request, tmp_path):
    nib.save(nib.Nifti1Image(LABELS, np.eye(4)), tmp_path / request.param)
    return tmp_path / request.param


def test_what_was_written_is_read(path):
    np.testing.assert_array_equal(np.asarray(read_labels(path)), LABELS)


def test_a_header_bounds_what_is_unpacked(path):
    most = nifti_claim(nib.Nifti1Image, nifti_head(path), "l")
    assert LABELS.nbytes < most < LABELS.nbytes + (20 << 20)
    content = nifti_content(path, most=most)
    if path.suffix == ".gz":
        path.write_bytes(gzip.compress(bytes(content)) + gzip.compress(bytes(1 << 20)) * 20)
        with pytest.raises(ValueError, match="more than"):
            nifti_content(path, most=most)


@pytest.mark.parametrize("shape", [(), (-1, 4, 5), (32767, 32767, 32767), (MOST_VOXELS, 2)])
def test_extents_of_no_label_map(shape):
    assert check_extents((3, 4, 5), 2, "l.nii") == 120
    with pytest.raises(InputError, match=r"l\.nii"):
        check_extents(shape, 1, "l.nii")
