"""What a NIfTI header says about place, scale and handedness, and whether it says one thing."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mixpinn.anatomy.finding import Finding
from mixpinn.base.arrays import FloatArray
from mixpinn.base.errors import InputError

if TYPE_CHECKING:
    import nibabel as nib

_MM_PER_UNIT = {"unknown": 1.0, "mm": 1.0, "meter": 1000.0, "micron": 0.001}
_SCALE, _TURN, _SHIFT = 0.01, 45.0, 0.2
"""Two matrices say the same up to this share of a voxel size, this turn [degree] decides which side is which, and
corners this many voxels apart are rounding."""


def nifti_affine(path: Path, image: "nib.Nifti1Image") -> tuple[FloatArray, tuple[Finding, ...]]:
    """Voxel index to the scanner's RAS frame [mm], shape (4, 4), with what the header's two matrices disagree about.

    The sform is taken where it is given, as other programs do. Where sform and qform differ in spacing, handedness or
    by more than 45°, that is an error; a smaller turn or another place is a warning.

    Raises:
        InputError: the header has neither, or is not one of a volume.
    """
    header = image.header
    if len(image.shape) < 3:
        raise InputError(
            str(path), expected="a volume of three dimensions", got=f"shape {image.shape}", fix="give the whole image",
        )
    try:
        unit = _MM_PER_UNIT[header.get_xyzt_units()[0]]
    except KeyError as error:
        raise InputError(
            str(path), expected="lengths in metres, millimetres or micrometres", got="an unknown unit in the header",
            fix="write the image again",
        ) from error
    sform = _scaled(header.get_sform(coded=True)[0], unit)
    try:
        qform = _scaled(header.get_qform(coded=True)[0], unit)
    except (ValueError, np.linalg.LinAlgError):  # no rotation: a quaternion longer than 1
        qform = None
    taken = qform if sform is None else sform
    if taken is None:
        raise InputError(
            str(path), expected="an affine (sform or qform)",
            got="a header with neither, so left and right are unknown", fix="write the image with its orientation",
        )
    if not np.isfinite(taken).all() or (sform is None or qform is None):
        return taken, _against_pixdim(path, taken, np.asarray(header.get_zooms()[:3], dtype=np.float64) * unit)
    return taken, _disagreement(path, sform, qform, image.shape[:3])


def _scaled(affine: FloatArray | None, unit: float) -> FloatArray | None:
    if affine is None:
        return None
    affine = np.array(affine, dtype=np.float64)
    affine[:3] *= unit
    return affine


def _sizes(affine: FloatArray) -> FloatArray:
    size: FloatArray = np.linalg.norm(affine[:3, :3], axis=0)
    return size


def _codes(affine: FloatArray) -> str:
    """Letters of the sides that the axes go to; ? for an axis that goes nowhere of its own."""
    import nibabel as nib

    return "".join(code or "?" for code in nib.aff2axcodes(affine))


def _listed(sizes: FloatArray) -> str:
    return " × ".join(f"{size:.4g}" for size in sizes)


def _finding(path: Path, detail: str, *, error: bool) -> Finding:
    return Finding("affine", path.name, detail, 0, repairable=False, error=error)


def _against_pixdim(path: Path, affine: FloatArray, pixdim: FloatArray) -> tuple[Finding, ...]:
    sizes = _sizes(affine)
    if not np.isfinite(affine).all() or (np.abs(sizes - pixdim) <= _SCALE * sizes).all():
        return ()
    detail = f"the matrix has voxels of {_listed(sizes)} mm, pixdim says {_listed(pixdim)} mm; the matrix was taken"
    return (_finding(path, detail, error=False),)


def _disagreement(
    path: Path, sform: FloatArray, qform: FloatArray, shape: tuple[int, ...],
) -> tuple[Finding, ...]:
    s_size, q_size = _sizes(sform), _sizes(qform)
    if not np.isfinite(qform).all() or s_size.min() == 0.0 or q_size.min() == 0.0:
        return ()  # an unusable sform is refused by its own check, an unusable qform says nothing
    if (np.abs(s_size - q_size) > _SCALE * np.minimum(s_size, q_size)).any():
        detail = f"the sform has voxels of {_listed(s_size)} mm, the qform of {_listed(q_size)} mm"
        return (_finding(path, detail, error=True),)
    s_turn, q_turn = sform[:3, :3] / s_size, qform[:3, :3] / q_size
    cosines = (s_turn * q_turn).sum(axis=0)
    codes = _codes(sform), _codes(qform)
    if np.linalg.det(s_turn) * np.linalg.det(q_turn) < 0.0:
        detail = f"sform ({codes[0]}) and qform ({codes[1]}) differ in handedness: left and right are exchanged"
        return (_finding(path, detail, error=True),)
    angle = float(np.degrees(np.arccos(np.clip(cosines.min(), -1.0, 1.0))))
    if angle > _TURN:
        detail = f"sform ({codes[0]}) and qform ({codes[1]}) are turned against each other by {angle:.0f}°"
        return (_finding(path, detail, error=True),)
    corners = np.array(np.meshgrid(*[(0, n - 1) for n in shape])).reshape(3, -1)
    apart = float(np.linalg.norm((sform - qform)[:3] @ np.vstack([corners, np.ones(corners.shape[1])]), axis=0).max())
    if apart <= _SHIFT * s_size.min():
        return ()
    places = [", ".join(f"{value:.1f}" for value in matrix[:3, 3]) for matrix in (sform, qform)]
    detail = (
        f"sform and qform lie up to {apart:.3g} mm apart (first voxel at {places[0]} and {places[1]} mm, turned by "
        f"{angle:.1f}°); the sform was taken"
    )
    return (_finding(path, detail, error=False),)
