"""Reading one NIfTI file as a label image, with everything that can be wrong about it said in one line."""

import gzip
import zlib
from dataclasses import dataclass
from pathlib import Path

import nibabel as nib
import numpy as np

from mixpinn.base.arrays import AnyArray, FloatArray
from mixpinn.base.errors import InputError

_NIFTI2_HEADER_SIZE = 540
_MM_PER_UNIT = {"unknown": 1.0, "mm": 1.0, "meter": 1000.0, "micron": 0.001}


@dataclass(frozen=True, eq=False)
class LabelImage:
    """An image of whole numbers.

    Attributes:
        data: labels >= 0, an integer type, shape (ni, nj, nk).
        affine: voxel index to the scanner's RAS frame [mm], shape (4, 4).
    """

    data: AnyArray
    affine: FloatArray


def read_label_image(path: Path | str) -> LabelImage:
    """Read a ``.nii`` or ``.nii.gz`` as a label image.

    Raises:
        InputError: absent, damaged, not a NIfTI, not three-dimensional, without a usable affine, or with values that
            are not whole non-negative numbers.
    """
    path = Path(path)
    image = _open(path)
    shape = image.shape
    while len(shape) > 3 and shape[-1] == 1:
        shape = shape[:-1]
    if len(shape) != 3:
        raise InputError(
            str(path), expected="a 3-D image", got=f"a {len(shape)}-D image of shape {tuple(image.shape)}",
            fix="give one volume of it",
        )
    affine = _affine(path, image)
    try:
        data = np.asarray(image.dataobj).reshape(shape)
    except Exception as error:  # nibabel lets through what NumPy and zlib raise
        raise _damaged(path, error) from error
    return LabelImage(_whole_numbers(path, data), affine)


def check_same_grid(path: Path | str, image: LabelImage, reference_path: Path | str, reference: LabelImage) -> None:
    """Check that two images share one voxel grid, to a thousandth of a voxel at every corner.

    Raises:
        InputError: they do not.
    """
    fix = "resample it to the grid of the other structures"
    if image.data.shape != reference.data.shape:
        raise InputError(
            str(path), expected=f"the {reference.data.shape} voxels of {Path(reference_path).name}",
            got=f"{image.data.shape} voxels", fix=fix,
        )
    corners = np.array(np.meshgrid(*[(0, n - 1) for n in image.data.shape])).reshape(3, -1)
    apart = (image.affine - reference.affine) @ np.vstack([corners, np.ones(corners.shape[1])])
    distance = float(np.linalg.norm(apart[:3], axis=0).max())
    if distance > 1e-3 * np.linalg.norm(reference.affine[:3, :3], axis=0).min():
        raise InputError(
            str(path), expected=f"the affine of {Path(reference_path).name}",
            got=f"a grid up to {distance:.3g} mm away from it", fix=fix,
        )


def _open(path: Path) -> nib.Nifti1Image:
    if not path.is_file():
        raise InputError(str(path), expected="a NIfTI file", got="no such file", fix="check the path")
    content = path.read_bytes()
    if content[:2] == b"\x1f\x8b":
        try:
            content = gzip.decompress(content)  # the whole at once, so that the checksum is verified too
        except (OSError, EOFError, zlib.error) as error:
            raise _damaged(path, error) from error
    kind = nib.Nifti1Image
    if int.from_bytes(content[:4], "little") == _NIFTI2_HEADER_SIZE:
        kind = nib.Nifti2Image
    if content[344:347] not in (b"n+1", b"ni1") and content[4:7] not in (b"n+2", b"ni2"):
        raise InputError(
            str(path), expected="a NIfTI image", got="another kind of file", fix="convert it to .nii.gz",
        )
    try:
        return kind.from_bytes(content)
    except Exception as error:
        raise _damaged(path, error) from error


def _affine(path: Path, image: nib.Nifti1Image) -> FloatArray:
    header = image.header
    if int(header["sform_code"]) == 0 and int(header["qform_code"]) == 0:
        raise InputError(
            str(path), expected="an affine (sform or qform)",
            got="a header with neither, so left and right are unknown", fix="write the image with its orientation",
        )
    affine = np.array(image.affine, dtype=np.float64)
    if not np.isfinite(affine).all():
        raise InputError(
            str(path), expected="a finite affine", got="an affine with NaN or infinity", fix="write the image again",
        )
    columns = np.linalg.norm(affine[:3, :3], axis=0)
    if columns.min() == 0.0 or abs(np.linalg.det(affine[:3, :3] / columns)) < 1e-6:
        raise InputError(
            str(path), expected="an affine that can be inverted", got="a singular affine", fix="write the image again",
        )
    affine[:3] *= _MM_PER_UNIT.get(header.get_xyzt_units()[0], 1.0)
    return affine


def _whole_numbers(path: Path, data: AnyArray) -> AnyArray:
    fix = "give the label map, not the image it was made from"
    if data.dtype.kind == "b":
        return data.astype(np.uint8)
    if data.dtype.kind not in "iuf":
        raise InputError(str(path), expected="whole numbers", got=f"values of type {data.dtype}", fix=fix)
    if data.size == 0:
        raise InputError(str(path), expected="at least one voxel", got=f"shape {data.shape}", fix="check the file")
    low, high = data.min(), data.max()
    if data.dtype.kind == "f":
        if not (np.isfinite(low) and np.isfinite(high)):
            raise InputError(str(path), expected="finite whole numbers", got="NaN or infinity", fix=fix)
        if (data != np.rint(data)).any():
            raise InputError(str(path), expected="whole numbers", got="continuous values", fix=fix)
    if low < 0 or high > 65535:
        raise InputError(str(path), expected="labels of 0 to 65535", got=f"values of {low:g} to {high:g}", fix=fix)
    return data.astype(np.uint8 if high <= 255 else np.uint16, copy=False)


def _damaged(path: Path, error: Exception) -> InputError:
    return InputError(
        str(path), expected="a complete NIfTI file", got=f"a damaged one ({error})", fix="copy or write it again",
    )
