"""Label images on one lattice: masks in boxes of their own, other orders of axes, grids that differ by rounding."""

from pathlib import Path

import numpy as np

from mixpinn.anatomy.finding import Finding
from mixpinn.anatomy.images.label_image import LabelImage
from mixpinn.anatomy.segmentation import Index3
from mixpinn.base.arrays import AnyArray
from mixpinn.base.errors import InputError

_TAKEN, _SAID = 0.2, 1e-3
"""Grids up to this many voxels apart are taken as one; beyond the second with a note."""


def on_lattice(
    path: Path | str, image: LabelImage, reference_path: Path | str, reference: LabelImage,
) -> tuple[AnyArray, Index3, tuple[Finding, ...]]:
    """The image's labels on the grid of another image.

    Args:
        path: of the image, for messages.
        image: the image; its axes may run in another order or direction, and its box may be another one.
        reference_path: of the other image.
        reference: the image whose voxel grid counts.

    Returns:
        labels along the reference's axes, the reference's index of their first voxel, and what was noticed.

    Raises:
        InputError: the two do not share one lattice to a fifth of a voxel.
    """
    import nibabel as nib

    to_reference = np.linalg.inv(reference.affine) @ image.affine
    turn = np.rint(to_reference[:3, :3])
    fix = "resample it to the grid of the other structures"
    name = Path(reference_path).name
    if not (np.abs(turn).sum(axis=0) == 1).all() or not (np.abs(turn).sum(axis=1) == 1).all():
        raise InputError(
            str(path), expected=f"the voxel size and axes of {name}",
            got=_described(image) + " instead of " + _described(reference), fix=fix,
        )
    exact = np.eye(4)
    exact[:3, :3] = turn
    middle = 0.5 * (np.array(image.data.shape) - 1.0)
    # The whole step between the grids is the one at the middle, where a small turn or scale moves least.
    exact[:3, 3] = np.rint(to_reference[:3, :3] @ middle + to_reference[:3, 3] - turn @ middle)
    corners = np.array(np.meshgrid(*[(0, n - 1) for n in image.data.shape])).reshape(3, -1)
    apart = float(np.abs((to_reference - exact)[:3] @ np.vstack([corners, np.ones(corners.shape[1])])).max())
    if apart > _TAKEN:
        raise InputError(
            str(path), expected=f"the affine of {name}", got=f"a grid up to {apart:.3g} voxels away from it", fix=fix,
        )
    orientation = nib.io_orientation(exact)
    labels = nib.apply_orientation(image.data, orientation)
    first = (exact @ nib.orientations.inv_ornt_aff(orientation, image.data.shape))[:3, 3]
    corner = (round(float(first[0])), round(float(first[1])), round(float(first[2])))
    notes: tuple[Finding, ...] = ()
    if apart > _SAID:
        detail = f"its grid is up to {apart:.2g} voxels away from {name}: taken as the same"
        notes = (Finding("grid", Path(path).name, detail, 0, repairable=False),)
    return np.ascontiguousarray(labels), corner, notes


def _described(image: LabelImage) -> str:
    import nibabel as nib

    sizes = " × ".join(f"{size:.4g}" for size in np.linalg.norm(image.affine[:3, :3], axis=0))
    return f"{sizes} mm along {''.join(nib.aff2axcodes(image.affine))}"
