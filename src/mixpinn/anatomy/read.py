"""Reading label maps: a folder with one NIfTI a structure, or one NIfTI with many labels."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy import ndimage

from mixpinn.anatomy.names import TOTAL_CLASSES, is_lumbar, read_names, unknown_structure
from mixpinn.anatomy.nifti import LabelImage, check_same_grid, read_label_image
from mixpinn.anatomy.segmentation import Index3, Segmentation, Structure
from mixpinn.anatomy.select import check_roles, find_body, select_files, structure_name
from mixpinn.base.arrays import AnyArray, BoolArray, IntArray
from mixpinn.base.errors import InputError
from mixpinn.base.progress import track

_TRUNK = 1
"""Label of the trunk in the two-label image that TotalSegmentator's task "body" writes (2: the extremities)."""


def read_folder(
    folder: Path | str, *, body: Path | str | None = None, rigid: Sequence[str] | None = None, soft: Sequence[str] = (),
) -> Segmentation:
    """Read a folder with one binary NIfTI a structure, named after it (TotalSegmentator's layout).

    Args:
        folder: the folder.
        body: structure that is the body, or a file elsewhere; by default ``body_trunc``, ``body_trunc_*``, ``body``,
            ``trunk`` or ``torso``, whichever comes first.
        rigid: names of the rigid parts; by default every lumbar vertebra there is.
        soft: names of further soft tissues inside the body.

    Raises:
        InputError: a structure is missing, empty, damaged, not a binary label map, or on another grid.
    """
    selection = select_files(folder, body=body, rigid=rigid, soft=soft)
    structures: dict[str, Structure] = {}
    reference: tuple[Path, LabelImage] | None = None
    for name, path in track(selection.files().items(), "Reading label maps"):
        image = read_label_image(path)
        if reference is None:
            reference = path, image
        check_same_grid(path, image, *reference)
        structures[name] = Structure.trim(name, _binary(path, image, body=path == selection.body))
    assert reference is not None
    return Segmentation(
        body=structures[structure_name(selection.body)],
        soft=tuple(structures[name] for name in selection.soft),
        rigid=tuple(structures[name] for name in selection.rigid),
        affine=reference[1].affine, shape=_shape(reference[1]),
    )


def read_multilabel(
    file: Path | str, *, names: Mapping[int, str] | Path | str | None = None, body: Path | str | None = None,
    rigid: Sequence[str] | None = None, soft: Sequence[str] = (),
) -> Segmentation:
    """Read one NIfTI in which each structure has a number.

    Args:
        file: the image.
        names: name of each number, or a JSON file of it; by default the classes of TotalSegmentator's task "total".
        body: name of the body's label, or a file with the body on the same grid. The task "total" has no body, so a
            file is needed with it: a mask, or what TotalSegmentator's task "body" writes. A label of the same image is
            taken together with all structures that lie in it, since each voxel of such an image has one label only.
        rigid: names of the rigid parts; by default every lumbar vertebra there is.
        soft: names of further soft tissues inside the body.

    Raises:
        InputError: a structure is missing, a number has no name, or the image is not a label map.
    """
    table = TOTAL_CLASSES if names is None else names if isinstance(names, Mapping) else read_names(names)
    image = read_label_image(file)
    counts = _count_labels(image.data)
    present = [int(number) for number in np.flatnonzero(counts) if number != 0]
    for number in present:
        if number not in table:
            raise InputError(
                str(file), expected="labels of the name table only", got=f"label {number} ({counts[number]} voxels)",
                fix="give the table that belongs to this image",
            )
    numbers = {table[number]: number for number in present}
    body_structure = _body_of_multilabel(Path(file), image, numbers, body)
    if rigid is None:
        rigid = [name for name in numbers if is_lumbar(name)]
        if not rigid:
            raise InputError(str(file), expected="lumbar vertebrae", got=f"only {', '.join(numbers) or 'background'}",
                             fix="name the rigid parts, or give the table that belongs to this image")
    check_roles(body_structure.name, soft, rigid)
    for name in (*soft, *rigid):
        if name not in table.values():
            raise unknown_structure(name, table.values(), where="the name table")
        if name not in numbers:
            raise _empty(name, Path(file))
    boxes = ndimage.find_objects(image.data)
    return Segmentation(
        body=body_structure,
        soft=tuple(_label(image, name, numbers[name], boxes) for name in soft),
        rigid=tuple(_label(image, name, numbers[name], boxes) for name in rigid),
        affine=image.affine, shape=_shape(image),
    )


def _shape(image: LabelImage) -> Index3:
    first, second, third = image.data.shape
    return first, second, third


def _count_labels(labels: AnyArray) -> IntArray:
    length = int(labels.max()) + 1
    counts = np.zeros(length, dtype=np.int64)
    for plane in labels:  # plane by plane: counting needs eight bytes a voxel
        counts += np.bincount(plane.ravel(), minlength=length)
    return counts


def _label(image: LabelImage, name: str, number: int, boxes: Sequence[tuple[slice, slice, slice]]) -> Structure:
    box = boxes[number - 1]
    return Structure.trim(name, image.data[box] == number, (box[0].start, box[1].start, box[2].start))


def _binary(path: Path, image: LabelImage, *, body: bool = False) -> BoolArray:
    high = image.data.max()
    if high == 0:
        raise _empty(structure_name(path), path)
    mask: BoolArray = image.data == high
    if np.count_nonzero(image.data) != np.count_nonzero(mask):
        trunk: BoolArray = image.data == _TRUNK
        if body and high == 2 and trunk.any():
            return trunk
        raise InputError(
            str(path), expected="one structure (0 and one other value)", got=f"several labels, up to {high}",
            fix="read it as a multi-label image, or give one file a structure",
        )
    return mask


def _body_of_multilabel(
    file: Path, image: LabelImage, numbers: Mapping[str, int], body: Path | str | None,
) -> Structure:
    if body is None:
        candidates = find_body(numbers)
        if len(candidates) != 1:
            raise InputError(
                str(file), expected="a label for the body", got=", ".join(candidates) or "none",
                fix="give the body as a second file (TotalSegmentator's task 'body') or name its label",
            )
        body = candidates[0]
    if str(body) in numbers:
        others = [number for name, number in numbers.items() if name.startswith("body_") and name != str(body)]
        inside = (image.data != 0) & ~np.isin(image.data, others) if others else image.data != 0
        return Structure.trim(str(body), inside)
    if not Path(body).is_file():
        raise unknown_structure(str(body), numbers, where=f"{file} or a file")
    other = read_label_image(body)
    check_same_grid(body, other, file, image)
    return Structure.trim("body", _binary(Path(body), other, body=True))


def _empty(name: str, path: Path) -> InputError:
    return InputError(
        name, expected="at least one voxel", got=f"none in {path}",
        fix="segment the structure again, or leave it out by naming the structures to use",
    )


