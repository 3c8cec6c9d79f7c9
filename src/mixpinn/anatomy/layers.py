"""Layers of fat and muscle that a mesh can hold: from label maps, or from the CT by windows of its HU.

Cells are some millimetres long, so that a sheet thinner than that cannot be meshed. Every voxel of the soft body is
given the tissue that fills most of its neighbourhood: with the share of tissue T weighted by a Gaussian,

    share_T(x) = ∫ G_σ(x − y) 1_T(y) dy,    tissue(x) = argmax_T share_T(x),

a flat layer of thickness t survives if erf(t / (2 √2 σ)) > ½, that is t > 1.349 σ. What is thinner is homogenised into
what it lies in. Bones and what is outside of the body take no part; volumes before and after are stated.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

from mixpinn.anatomy.finding import Finding, require_sound
from mixpinn.anatomy.images.label_image import check_affine
from mixpinn.anatomy.images.nifti import open_nifti
from mixpinn.anatomy.images.nifti_affine import nifti_affine
from mixpinn.anatomy.names import tissue_group
from mixpinn.anatomy.segmentation import Segmentation, Structure
from mixpinn.base.arrays import BoolArray, FloatArray
from mixpinn.base.errors import InputError

if TYPE_CHECKING:
    import nibabel as nib

FAT_HU, MUSCLE_HU = (-190.0, -30.0), (-29.0, 150.0)
"""Windows of adipose tissue and skeletal muscle [HU]: table 1 of Sci. Rep. 2025, doi:10.1038/s41598-025-96238-6 (the
table was read); the same as in common use for body composition. Organs fall into the window of muscle."""
THINNEST = 5.0
"""Layers from this thickness on are kept [mm]."""
_SURVIVES = 1.349
_SMALLEST = 2000.0
"""Pieces of a layer below this volume are given to the body [mm³]."""


def split_layers(segmentation: Segmentation) -> tuple[Segmentation, tuple[Structure, ...]]:
    """The segmentation without its soft tissues that are layers of fat or muscle, and these."""
    layers = tuple(part for part in segmentation.soft if tissue_group(part.name) in ("fat", "muscle"))
    return replace(segmentation, soft=tuple(part for part in segmentation.soft if part not in layers)), layers


def add_layers(
    segmentation: Segmentation, layers: tuple[Structure, ...], *, thinnest: float = THINNEST,
) -> Segmentation:
    """Layers of label maps as soft tissues of the segmentation, as far as a mesh can hold them.

    Args:
        segmentation: without them, repaired.
        layers: their masks on the same grid; of overlapping ones the later wins.
        thinnest: layers from this thickness on are kept [mm].
    """
    start, stop = segmentation.body.box
    masks = {layer.name: layer.window(start, stop) for layer in layers}
    return _laid(segmentation, masks, thinnest)


def layers_of_ct(
    segmentation: Segmentation, file: Path | str, *, thinnest: float = THINNEST,
) -> Segmentation:
    """Fat and muscle from the CT that the maps were made of, as soft tissues; what is neither stays the body's.

    Args:
        segmentation: body and bones, repaired.
        file: the CT in HU, on any grid in the same scanner frame.
        thinnest: layers from this thickness on are kept [mm].

    Raises:
        InputError: no image in HU, one whose header does not say where it is, or one that does not cover the body.
    """
    start, stop = segmentation.body.box
    hounsfield = ndimage.median_filter(_sample(file, segmentation.affine, start, stop), size=3)
    windows = {"fat": FAT_HU, "muscle": MUSCLE_HU}
    masks = {name: (hounsfield >= low) & (hounsfield <= high) for name, (low, high) in windows.items()}
    return _laid(segmentation, masks, thinnest)


def _laid(segmentation: Segmentation, masks: Mapping[str, BoolArray], thinnest: float) -> Segmentation:
    if not masks:
        return segmentation
    body = segmentation.body
    start, stop = body.box
    inside = body.mask.copy()
    for part in (*segmentation.rigid, *segmentation.soft):
        inside &= ~part.window(start, stop)
    taken = np.zeros_like(inside)
    given: dict[str, BoolArray] = {}
    for name in reversed(list(masks)):
        given[name] = masks[name] & inside & ~taken
        taken |= given[name]
    given = {name: given[name] for name in masks}
    volume = float(np.prod(segmentation.spacing))
    sigma = thinnest / _SURVIVES / segmentation.spacing
    shares = [_share(inside & ~taken, sigma), *(_share(mask, sigma) for mask in given.values())]
    best = np.argmax(shares, axis=0)
    soft, notes = list(segmentation.soft), list(segmentation.notes)
    for number, (name, mask) in enumerate(given.items(), start=1):
        pieces, count = ndimage.label((best == number) & inside)
        sizes = np.bincount(pieces.ravel(), minlength=count + 1) * volume
        sizes[0] = 0.0
        kept = (sizes >= _SMALLEST)[pieces]
        before, after, lost = mask.sum() * volume, kept.sum() * volume, (mask & ~kept).sum() * volume
        text = (
            f"a layer of {after / 1e6:.2f} litres, before {before / 1e6:.2f}: {lost / 1e6:.2f} in sheets thinner than "
            f"{thinnest:g} mm or in small pieces went to the tissue that fills most of their neighbourhood"
        )
        notes.append(Finding("layer", name, text, int(kept.sum()), repairable=False))
        if kept.any():
            soft.append(Structure.trim(name, kept, start))
    return replace(segmentation, soft=tuple(soft), notes=tuple(notes))


def _share(mask: BoolArray, sigma: FloatArray) -> FloatArray:
    """Share of the neighbourhood that a tissue fills; what is outside of the array counts as its edge."""
    share: FloatArray = ndimage.gaussian_filter(mask.astype(np.float32), sigma, mode="nearest", truncate=3.0)
    return share


def _affine(path: Path, image: "nib.Nifti1Image") -> FloatArray:
    """Voxel index of a CT to the scanner's RAS frame [mm], shape (4, 4), under the checks of a label image."""
    affine, notes = nifti_affine(path, image)
    require_sound(notes)
    check_affine(path, affine)
    return affine


def _sample(file: Path | str, affine: FloatArray, start: tuple[int, ...], stop: tuple[int, ...]) -> FloatArray:
    """HU at the voxels start … stop of the grid of the maps, linear between those of the CT."""
    try:
        image = open_nifti(Path(file))
        data = np.asarray(image.dataobj, dtype=np.float32)
    except InputError:
        raise
    except Exception as error:  # nibabel raises many kinds
        raise InputError(
            str(file), expected="a CT (.nii.gz)", got=f"{type(error).__name__}: {error}", fix="check the file",
        ) from error
    if data.ndim != 3 or not data.min() < -500.0:
        raise InputError(
            str(file), expected="a CT in HU, with air at -1000", got=f"values from {data.min():g} to {data.max():g}",
            fix="give the CT that the maps were made of, in HU",
        )
    to_image = np.linalg.inv(_affine(Path(file), image)) @ affine
    shape = tuple(b - a for a, b in zip(start, stop, strict=True))
    shift = to_image[:3, :3] @ np.array(start) + to_image[:3, 3]
    corners = np.array(np.meshgrid(*[(0, n - 1) for n in shape])).reshape(3, -1)
    reached = to_image[:3, :3] @ corners + shift[:, None]
    if reached.min() < -1.0 or (reached.max(axis=1) > np.array(data.shape)).any():
        raise InputError(
            str(file), expected="a CT that covers the body of the maps", got="one that ends before",
            fix="give the CT that the maps were made of",
        )
    sampled: FloatArray = ndimage.affine_transform(
        data, to_image[:3, :3], shift, output_shape=shape, order=1, mode="nearest",
    )
    return sampled
