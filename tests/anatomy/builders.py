"""Small segmentations and NIfTI files, made by hand."""

from pathlib import Path

import nibabel as nib
import numpy as np

from mixpinn.anatomy import Segmentation, Structure

SHAPE = (12, 11, 20)


def block(low, high, shape=SHAPE):
    """Mask of a box from index low to high, both included."""
    mask = np.zeros(shape, dtype=bool)
    mask[tuple(slice(a, b + 1) for a, b in zip(low, high, strict=True))] = True
    return mask


def masks():
    """Body and two vertebrae, L1 above L2 in an RAS grid, nothing wrong with them."""
    return {
        "body_trunc": block((1, 1, 0), (10, 9, 19)),
        "vertebrae_L1": block((4, 4, 11), (7, 7, 13)),
        "vertebrae_L2": block((4, 4, 6), (7, 7, 8)),
    }


def segmentation(structures=None, *, affine=None, body="body_trunc", soft=()):
    """A `Segmentation` of masks on one grid; every structure but body and soft is rigid."""
    structures = masks() if structures is None else structures
    return Segmentation(
        body=Structure.trim(body, structures[body]),
        soft=tuple(Structure.trim(name, structures[name]) for name in soft),
        rigid=tuple(
            Structure.trim(name, mask) for name, mask in structures.items() if name != body and name not in soft
        ),
        affine=np.eye(4) if affine is None else affine, shape=structures[body].shape,
    )


def full(structure, shape=SHAPE):
    """The structure's mask on the whole grid."""
    return structure.window((0, 0, 0), shape)


def write_nifti(path: Path, data, affine=None) -> Path:
    """Write data (bool as uint8) with an affine, by default 1 mm RAS."""
    data = data.astype(np.uint8) if data.dtype == bool else data
    nib.save(nib.Nifti1Image(data, np.eye(4) if affine is None else affine), path)
    return path


def write_folder(folder: Path, structures=None, affine=None) -> Path:
    """Write one file a structure."""
    folder.mkdir(exist_ok=True)
    for name, mask in (masks() if structures is None else structures).items():
        write_nifti(folder / f"{name}.nii.gz", mask, affine)
    return folder
