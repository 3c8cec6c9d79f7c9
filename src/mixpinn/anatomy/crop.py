"""From structures on an image grid to the label map that is meshed: crop along the body, then the world frame."""

from dataclasses import replace

import numpy as np

from mixpinn.anatomy.bones import clip_bones
from mixpinn.anatomy.checks.labels import filled
from mixpinn.anatomy.segmentation import Segmentation, Structure
from mixpinn.base.arrays import AnyArray, FloatArray
from mixpinn.base.errors import InputError
from mixpinn.records.label_map import SCANNER_TO_WORLD, LabelMap

CROP_ABOVE = 65.0
"""Default height of the crop above the highest rigid part [mm]."""
CROP_BELOW = 50.0
"""Default depth of the crop below the lowest rigid part [mm]."""

_TOLERANCE = 1e-3
"""A voxel centre this close to a crop plane counts as inside [mm], so that rounding of the affine decides nothing."""


def crop(segmentation: Segmentation, *, above: float = CROP_ABOVE, below: float = CROP_BELOW) -> Segmentation:
    """Keep the slab from `above` [mm] above the highest to `below` [mm] below the lowest target, and what is in it.

    The targets are all rigid parts where the segmentation names none; of bones beside them only what lies in the slab
    is kept (`mixpinn.anatomy.bones.clip_bones`).

    Heights are the scanner's S. Parts reach to the faces of their voxels; a voxel is kept where its centre is inside.
    The grid stays as it is, and so does an image that ends before the slab does.

    Raises:
        InputError: a margin is negative, or the body or a soft tissue has no voxel in the slab.
    """
    if not (above >= 0.0 and below >= 0.0):
        raise InputError("crop margins", expected="0 mm or more", got=f"{above:g} and {below:g}", fix="correct them")
    half_voxel = 0.5 * float(np.abs(segmentation.affine[2, :3]).sum())
    ranges = [
        _range(segmentation.heights(part), part.mask) for part in segmentation.rigid
        if not segmentation.targets or part.name in segmentation.targets
    ]
    low = min(first for first, _ in ranges) - half_voxel - below - _TOLERANCE
    high = max(last for _, last in ranges) + half_voxel + above + _TOLERANCE

    def cut(structure: Structure) -> Structure:
        height = segmentation.heights(structure)
        kept = Structure.trim(structure.name, structure.mask & (height >= low) & (height <= high), structure.corner)
        if kept.n_voxels == 0:
            raise InputError(
                structure.name, expected="voxels at the height of the rigid parts",
                got="none between the crop's planes", fix="leave it out or choose other rigid parts",
            )
        return kept

    if segmentation.targets and len(segmentation.targets) < len(segmentation.rigid):
        segmentation = clip_bones(segmentation, low, high)
    return replace(
        segmentation, body=cut(segmentation.body), soft=tuple(cut(tissue) for tissue in segmentation.soft),
    )


def place_in_frame(segmentation: Segmentation) -> LabelMap:
    """Paint the structures into one label map in the world frame (x, y, z) = (R, −A, −S).

    The origin is the centre of the body's bounding box. Grid axes are permuted and flipped to run along +x, +y and +z
    as nearly as they can, so that the same anatomy gives the same arrays however it was stored; nothing is resampled,
    and the affine carries the rotation of an oblique image. One voxel of background surrounds the body, so that its
    surface closes at the crop. Soft tissues are painted over the body and inside it only, holes of its mask included;
    rigid parts are painted over both.
    """
    import nibabel as nib

    everything = (segmentation.body, *segmentation.rigid)
    low = np.min([structure.corner for structure in everything], axis=0) - 1
    high = np.max([structure.stop for structure in everything], axis=0) + 1
    labels = np.zeros(high - low, dtype=np.uint8)
    rigid = sorted(segmentation.rigid, key=lambda part: -float((segmentation.affine[:3] @ [*part.centroid, 1.0])[2]))
    start, stop = (low[0], low[1], low[2]), (high[0], high[1], high[2])
    body = segmentation.body.window(start, stop)
    labels[body] = 1
    inside = body
    if any((tissue.window(start, stop) & ~body).any() for tissue in segmentation.soft):
        inside = filled(body)
    for number, tissue in enumerate(segmentation.soft, start=2):
        labels[tissue.window(start, stop) & inside] = number
    for number, part in enumerate(rigid, start=2 + len(segmentation.soft)):
        box = tuple(slice(a - o, b - o) for a, b, o in zip(part.corner, part.stop, low, strict=True))
        labels[box][part.mask] = number

    shift = np.eye(4)
    shift[:3, 3] = low
    affine = SCANNER_TO_WORLD @ segmentation.affine @ shift
    orientation = nib.io_orientation(affine)
    affine = affine @ nib.orientations.inv_ornt_aff(orientation, labels.shape)
    labels = np.ascontiguousarray(nib.apply_orientation(labels, orientation))

    centre = _bounding_box_centre(labels, affine)
    to_origin = np.eye(4)
    to_origin[:3, 3] = -centre
    world_to_scanner = np.linalg.inv(SCANNER_TO_WORLD) @ np.linalg.inv(to_origin)
    return LabelMap(
        labels=labels, affine=_rounded(to_origin @ affine), world_to_scanner=world_to_scanner,
        soft_names=(segmentation.body.name, *(tissue.name for tissue in segmentation.soft)),
        rigid_names=tuple(part.name for part in rigid),
        cut_names=tuple(part.name for part in rigid if part.name in segmentation.cut),
        target_names=tuple(part.name for part in rigid if part.name in segmentation.targets),
    )


def _range(values: FloatArray, mask: AnyArray) -> tuple[float, float]:
    inside = np.broadcast_to(values, mask.shape)[mask]
    return float(inside.min()), float(inside.max())


def _bounding_box_centre(labels: AnyArray, affine: FloatArray) -> FloatArray:
    # The voxel boxes reach equally far on both sides of the outermost centres, so the centres decide.
    surface = labels > 0
    surface[1:-1, 1:-1, 1:-1] &= ~(surface[:-2, 1:-1, 1:-1] & surface[2:, 1:-1, 1:-1])  # extremes lie at ends of rows
    points = np.argwhere(surface) @ affine[:3, :3].T + affine[:3, 3]
    centre: FloatArray = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return centre


def _rounded(affine: FloatArray) -> FloatArray:
    """The affine without the last digits, in which the same grid stored in another order differs."""
    result = np.round(affine, 9)
    result[:3, 3] = np.round(affine[:3, 3], 6)
    return result + 0.0  # no negative zeros
