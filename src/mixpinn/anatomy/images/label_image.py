"""LabelImage: whole numbers on a voxel grid in the scanner's frame, whatever file they came from."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mixpinn.anatomy.finding import Finding
from mixpinn.base.arrays import AnyArray, FloatArray
from mixpinn.base.errors import InputError

LPS_TO_RAS = np.diag([-1.0, -1.0, 1.0, 1.0])
"""From the frame of ITK, DICOM and NRRD to the one of NIfTI."""

_ROUNDING, _MOST_LABELS = 0.05, 1024
"""A stored label may be off its whole number by so much, in an image of at most so many different values."""


@dataclass(frozen=True, eq=False)
class LabelImage:
    """An image of whole numbers.

    Attributes:
        data: labels >= 0, an integer type, shape (ni, nj, nk).
        affine: voxel index to the scanner's RAS frame [mm], shape (4, 4).
        names: name of each number, where the file says it; else empty.
        notes: what was noticed while reading.
    """

    data: AnyArray
    affine: FloatArray
    names: Mapping[int, str] = field(default_factory=dict)
    notes: tuple[Finding, ...] = ()


def make_label_image(
    path: Path, data: AnyArray, affine: FloatArray, *, names: Mapping[int, str] | None = None,
    notes: tuple[Finding, ...] = (),
) -> LabelImage:
    """Check what a reader found: three dimensions, an affine that can be inverted, whole numbers >= 0.

    Raises:
        InputError: otherwise.
    """
    shape = data.shape
    while len(shape) > 3 and shape[-1] == 1:
        shape = shape[:-1]
    if len(shape) != 3:
        raise InputError(
            str(path), expected="a 3-D image", got=f"a {len(shape)}-D image of shape {tuple(data.shape)}",
            fix="give one volume of it",
        )
    check_affine(path, affine)
    labels, rounded = _whole_numbers(path, data.reshape(shape))
    return LabelImage(labels, np.asarray(affine, dtype=np.float64), dict(names or {}), (*notes, *rounded))


def flattened(
    path: Path, masks: Sequence[tuple[str, AnyArray]],
) -> tuple[AnyArray, dict[int, str], tuple[Finding, ...]]:
    """Masks that may overlap, by name, as one array of labels: the larger first, smaller ones painted over them.

    Returns:
        labels, the name of each number, and what was hidden.
    """
    ordered = sorted(masks, key=lambda entry: -int(np.count_nonzero(entry[1])))
    labels = np.zeros(ordered[0][1].shape, dtype=np.uint16)
    hidden = 0
    for number, (_, mask) in enumerate(ordered, start=1):
        hidden += int(np.count_nonzero(labels[mask])) if number > 1 else 0
        labels[mask] = number
    notes: tuple[Finding, ...] = ()
    if hidden:
        detail = f"segments overlap in {hidden} voxels; the smaller one of each was kept there"
        notes = (Finding("overlap", path.name, detail, hidden, repairable=False),)
    return labels, {number: name for number, (name, _) in enumerate(ordered, start=1)}, notes


def file_beside(path: Path, name: str) -> Path:
    """The file of voxels that a header names.

    Raises:
        InputError: no such file.
    """
    beside = path.parent / name
    try:
        found = beside.is_file()
    except OSError:  # a name that no file can have
        found = False
    if not found:
        raise InputError(
            str(path), expected=f"its data file {name[:60]!r}", got="no such file, or a list of files",
            fix="export it as .nii.gz",
        )
    return beside


def check_affine(path: Path, affine: FloatArray) -> None:
    """Refuse a matrix that places no voxels.

    Raises:
        InputError: not finite, or singular.
    """
    if not np.isfinite(affine).all():
        raise InputError(
            str(path), expected="a finite affine", got="an affine with NaN or infinity", fix="write the image again",
        )
    columns = np.linalg.norm(affine[:3, :3], axis=0)
    if columns.min() == 0.0 or abs(np.linalg.det(affine[:3, :3] / columns)) < 1e-6:
        raise InputError(
            str(path), expected="an affine that can be inverted", got="a singular affine", fix="write the image again",
        )


def _whole_numbers(path: Path, data: AnyArray) -> tuple[AnyArray, tuple[Finding, ...]]:
    fix = "give the label map with 0 around it, not the image it was made from"
    notes: tuple[Finding, ...] = ()
    if data.dtype.kind == "b":
        return data.astype(np.uint8), notes
    if data.dtype.names:
        raise InputError(
            str(path), expected="whole numbers", got="colours", fix="export the numbers of the labels instead",
        )
    if data.dtype.kind not in "iuf":
        raise InputError(str(path), expected="whole numbers", got=f"values of type {data.dtype}", fix=fix)
    if data.size == 0:
        raise InputError(str(path), expected="at least one voxel", got=f"shape {data.shape}", fix="check the file")
    low, high = data.min(), data.max()
    if data.dtype.kind == "f":
        if not (np.isfinite(low) and np.isfinite(high)):
            raise InputError(str(path), expected="finite whole numbers", got="NaN or infinity", fix=fix)
        whole = np.rint(data)
        off = np.abs(data - whole)
        largest = float(off.max())
        if largest > 0.0:
            if largest > _ROUNDING or high - low > 65535 or len(np.unique(whole)) > _MOST_LABELS:
                raise InputError(
                    str(path), expected="whole numbers",
                    got=f"continuous values from {low:.3g} to {high:.3g}, up to {largest:.3g} off a whole number",
                    fix="give the label map; of a probability or a smoothed mask, 1 where it is above a half, else 0",
                )
            detail = f"values up to {largest:.2g} off a whole number (a scaled header) were rounded"
            notes = (Finding("values", path.name, detail, int(np.count_nonzero(off)), repairable=False),)
        data, low, high = whole, np.rint(low), np.rint(high)
    if low < 0 or high > 65535:
        raise InputError(str(path), expected="labels of 0 to 65535", got=f"values of {low:g} to {high:g}", fix=fix)
    return data.astype(np.uint8 if high <= 255 else np.uint16, copy=False), notes
