"""Reading a DICOM segmentation (SEG) as a label image; needs the extra ``dicom`` (pydicom, MIT licence).

A SEG holds frames: each is a slice of one segment (DICOM PS3.3, A.51 and C.8.20), or of all of them where it is a label
map. Slices without a voxel may be left out, so the grid is put together from the places of those that are there.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mixpinn.anatomy.finding import Finding
from mixpinn.anatomy.images.label_image import LPS_TO_RAS, LabelImage, flattened, make_label_image
from mixpinn.base.arrays import AnyArray, FloatArray
from mixpinn.base.errors import InputError
from mixpinn.records.voxels import check_extents

_SEGMENTATIONS = ("1.2.840.10008.5.1.4.1.1.66.4", "1.2.840.10008.5.1.4.1.1.66.7")
"""Segmentation Storage and Label Map Segmentation Storage."""
_OFF = 0.1
"""A slice may be this many slice spacings away from its place on the grid."""
_MOST_IN_FRAMES = 2**34
"""Voxels of all frames together: there is one for each segment in each slice."""


def is_dicom(path: Path) -> bool:
    """Whether the file says that it is DICOM."""
    with path.open("rb") as file:
        return file.read(132)[128:] == b"DICM"


def read_dicom_seg(path: Path) -> LabelImage:
    """Read a DICOM segmentation; names are the labels of its segments.

    Where segments overlap, the larger are painted first and smaller ones over them.

    Raises:
        InputError: pydicom is not installed, or the file is damaged, another kind of DICOM, or its slices are no grid.
    """
    try:
        import pydicom
    except ImportError as error:
        raise InputError(
            str(path), expected="the package pydicom, which reads DICOM", got="it is not installed",
            fix="pip install 'mixpinn[dicom]', or export the segmentation as .nii.gz",
        ) from error
    try:
        image = pydicom.dcmread(path)
        kind = image.get("SOPClassUID", "")
        if kind not in _SEGMENTATIONS:
            raise InputError(
                str(path), expected="a DICOM segmentation (SEG)", got=getattr(kind, "name", "") or "another kind",
                fix="give the file of the segmentation, not the images or contours it belongs to",
            )
        names = {int(segment.SegmentNumber): _name(segment) for segment in image.SegmentSequence}
        frames = _frames(path, image)
        segments, places, steps = _geometry(path, image, len(frames))
    except InputError:
        raise
    except Exception as error:  # damaged files make pydicom raise many kinds
        raise InputError(
            str(path), expected="a readable DICOM segmentation",
            got=f"{type(error).__name__}: {' '.join(str(error).split())[:120]}", fix="copy or export it again",
        ) from error
    affine, index = _grid(path, places, steps)
    shape = (frames.shape[2], frames.shape[1], int(index.max()) + 1)
    check_extents(shape, np.dtype(np.uint16).itemsize, str(path))  # two slices far apart claim all between them
    if image.SegmentationType == "LABELMAP":
        data = np.zeros(shape, dtype=np.uint16)
        data[:, :, index] = frames.transpose(2, 1, 0)
        return make_label_image(path, data, affine, names=names)
    least, notes = 0.5, tuple[Finding, ...]()
    if image.SegmentationType == "FRACTIONAL":
        least = 0.5 * float(image.MaximumFractionalValue)
        detail = "fractions of a voxel: those of a half or more were taken"
        notes = (Finding("values", path.name, detail, int(np.count_nonzero(frames)), repairable=False),)
    masks = []
    for number in sorted(set(segments)):
        mask = np.zeros(shape, dtype=bool)
        for at in np.flatnonzero(np.array(segments) == number):
            mask[:, :, index[at]] |= np.greater_equal(frames[at].T, least)
        masks.append((names.get(number, f"segment_{number}"), mask))
    labels, table, overlaps = flattened(path, masks)
    return make_label_image(path, labels, affine, names=table, notes=(*notes, *overlaps))


def _bad(path: Path, expected: str, got: str) -> InputError:
    return InputError(str(path), expected=expected, got=got, fix="export it as .nii.gz")


def _name(segment: Any) -> str:
    """What a segment is called: its label, else its description, else the meaning of its code."""
    for name in ("SegmentLabel", "SegmentDescription"):
        if str(segment.get(name, "")).strip():
            return str(segment[name].value).strip()
    codes = segment.get("SegmentedPropertyTypeCodeSequence", ())
    return str(codes[0].CodeMeaning).strip() if codes else f"segment_{segment.SegmentNumber}"


def _frames(path: Path, image: Any) -> AnyArray:
    """Voxels of each frame, shape (frames, rows, columns)."""
    count = int(image.get("NumberOfFrames", 1))
    rows, columns = int(image.Rows), int(image.Columns)
    packed = not image.file_meta.TransferSyntaxUID.is_compressed
    expected = -(-count * rows * columns * int(image.BitsAllocated) // 8)
    if packed and len(image.PixelData) < expected:
        raise InputError(
            str(path), expected=f"{expected} bytes of voxels", got=f"{len(image.PixelData)}",
            fix="copy or export it again",
        )
    if count * rows * columns > _MOST_IN_FRAMES:
        raise _bad(path, "frames that fit in memory", f"{count} of {rows} × {columns}")
    voxels: AnyArray = np.asarray(image.pixel_array).reshape(count, rows, columns)
    return voxels


def _geometry(path: Path, image: Any, count: int) -> tuple[list[int], FloatArray, FloatArray]:
    """Segment and place (LPS) [mm] of each frame, and the steps along columns, rows and slices [mm], shape (3, 3)."""
    shared = image.SharedFunctionalGroupsSequence[0] if "SharedFunctionalGroupsSequence" in image else None
    each = image.PerFrameFunctionalGroupsSequence
    if len(each) != count:
        raise _bad(path, f"the place of each of {count} frames", f"{len(each)}")

    def group(frame: Any, name: str) -> Any:
        for holder in (frame, shared):
            if holder is not None and name in holder:
                return holder[name].value[0]
        raise _bad(path, f"frames with {name}", "none")

    label_map = image.SegmentationType == "LABELMAP"
    segments = [
        0 if label_map else int(group(frame, "SegmentIdentificationSequence").ReferencedSegmentNumber) for frame in each
    ]
    places = np.array([group(frame, "PlanePositionSequence").ImagePositionPatient for frame in each], dtype=np.float64)
    turns = np.array(
        [group(frame, "PlaneOrientationSequence").ImageOrientationPatient for frame in each], dtype=np.float64,
    )
    measures = group(each[0], "PixelMeasuresSequence")
    spacings = np.array([group(frame, "PixelMeasuresSequence").PixelSpacing for frame in each], dtype=np.float64)
    if np.abs(turns - turns[0]).max() > 1e-3 or np.abs(spacings / spacings[0] - 1.0).max() > 1e-3:
        raise _bad(path, "slices of one direction and pixel size", "several")
    between_rows, between_columns = spacings[0]
    first, second = turns[0, :3], turns[0, 3:]
    between = float(measures.get("SpacingBetweenSlices", 0.0) or 0.0) or float(measures.get("SliceThickness", 0.0) or 0)
    steps = np.stack([first * between_columns, second * between_rows, np.cross(first, second) * between])
    return segments, places, steps


def _grid(path: Path, places: FloatArray, steps: FloatArray) -> tuple[FloatArray, Any]:
    """The matrix to RAS [mm], and the slice on the grid that each frame is."""
    normal = np.cross(steps[0], steps[1])
    normal /= np.linalg.norm(normal)
    along = places @ normal
    heights = _distinct(along)
    step = steps[2]
    first = places[int(along.argmin())]
    if len(heights) > 1:
        gap, said = float(np.diff(heights).min()), float(np.linalg.norm(step))
        parts = gap / said if said > 0.0 else 0.0
        spacing = said if parts > 0.5 and abs(parts - round(parts)) < _OFF else gap
        count = round((heights[-1] - heights[0]) / spacing)
        step = (places[int(along.argmax())] - first) / count
    elif not np.linalg.norm(step) > 0.0:
        raise _bad(path, "the thickness of its only slice", "none")
    index = np.rint((along - heights[0]) / float(step @ normal)).astype(int)
    apart = np.linalg.norm(places - (first + index[:, None] * step), axis=1).max() / np.linalg.norm(step)
    if apart > _OFF:
        raise _bad(path, "slices at even distances", f"one that is {apart:.2g} slices away from its place")
    affine = np.eye(4)
    affine[:3, :3] = np.stack([steps[0], steps[1], step], axis=1)
    affine[:3, 3] = first
    return LPS_TO_RAS @ affine, index


def _distinct(values: Sequence[float] | FloatArray) -> FloatArray:
    """Values that differ by more than rounding, sorted."""
    ordered = np.sort(np.asarray(values, dtype=np.float64))
    return ordered[np.concatenate([[True], np.diff(ordered) > 1e-2])]
