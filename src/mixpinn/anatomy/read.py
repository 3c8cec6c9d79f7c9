"""Reading label maps: a folder with one image a structure, or one image with many labels."""

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy import ndimage

from mixpinn.anatomy.bones import bones_among, choose_bones
from mixpinn.anatomy.checks.numbering import check_numbering, look
from mixpinn.anatomy.checks.sides import LANDMARKS, check_sides
from mixpinn.anatomy.finding import Finding
from mixpinn.anatomy.images.image_file import label_files, read_label_image, structure_name
from mixpinn.anatomy.images.label_image import LabelImage
from mixpinn.anatomy.images.lattice import on_lattice
from mixpinn.anatomy.name_table import read_names
from mixpinn.anatomy.names import TOTAL_CLASSES, is_lumbar, unknown_structure
from mixpinn.anatomy.segmentation import Index3, Segmentation, Structure
from mixpinn.anatomy.select import check_roles, find_body, select_files, with_layers
from mixpinn.base.arrays import AnyArray, BoolArray, FloatArray, IntArray
from mixpinn.base.errors import InputError
from mixpinn.base.progress import track

_TRUNK = 1
"""Label of the trunk in the two-label image that TotalSegmentator's task "body" writes (2: the extremities)."""


def read_folder(
    folder: Path | str, *, body: Path | str | None = None, rigid: Sequence[str] | None = None, soft: Sequence[str] = (),
    target: Sequence[str] | None = None, lumbar_only: bool = False, layers: bool = False,
) -> Segmentation:
    """Read a folder with one binary NIfTI a structure, named after it (TotalSegmentator's layout).

    Args:
        folder: the folder; masks may lie each in a box of its own on one lattice.
        body: structure that is the body, or a file elsewhere; by default ``body_trunc``, ``body_trunc_*``, ``body``,
            ``trunk`` or ``torso``, whichever comes first.
        rigid: names of the rigid parts; by default every bone there is.
        soft: names of further soft tissues inside the body.
        target: the rigid parts that the crop follows; by default the lumbar vertebrae.
        lumbar_only: of the bones only the lumbar vertebrae are rigid, as in the paper.
        layers: take every fat, muscle and disc there is as a soft tissue.

    Raises:
        InputError: a structure is missing, damaged, not a binary label map, or on another grid; one that was named, or
            a lumbar vertebra, is empty.
    """
    selection = select_files(
        folder, body=body, rigid=rigid, soft=soft, target=target, lumbar_only=lumbar_only, layers=layers,
    )
    structures: dict[str, Structure] = {}
    reference: tuple[Path, LabelImage] | None = None
    notes: list[Finding] = []
    shapes: list[tuple[Index3, Index3]] = []
    asked = {structure_name(selection.body), *(rigid or ()), *soft, *(target or ())}
    for name, path in track(selection.files().items(), "Reading label maps"):
        image = read_label_image(path)
        if name not in asked and not is_lumbar(name) and not image.data.any():
            continue  # what is not in the image has an empty mask in TotalSegmentator's folders
        if reference is None:
            reference = path, image
        mask = replace(image, data=_binary(path, image, body=path == selection.body))
        labels, corner, placed = on_lattice(path, mask, *reference)
        structures[name] = Structure.trim(name, labels, corner)
        shapes.append((corner, _end(corner, labels)))
        notes += [*image.notes, *placed]
    assert reference is not None
    notes += check_sides(_centres(structures, reference[1].affine) | _landmarks(Path(folder)))
    read = Segmentation(
        body=structures[structure_name(selection.body)],
        soft=tuple(structures[name] for name in selection.soft if name in structures),
        rigid=tuple(structures[name] for name in selection.rigid if name in structures),
        affine=reference[1].affine, shape=_shape(reference[1]), notes=tuple(notes), targets=selection.targets,
    )
    return _on_common_grid(read, shapes)


def read_multilabel(
    file: Path | str, *, names: Mapping[int, str] | Path | str | None = None, body: Path | str | None = None,
    rigid: Sequence[str] | None = None, soft: Sequence[str] = (), target: Sequence[str] | None = None,
    lumbar_only: bool = False, layers: bool = False,
) -> Segmentation:
    """Read one NIfTI in which each structure has a number.

    Args:
        file: the image.
        names: name of each number, or a file of it (see `read_names`); by default the names in the image's header,
            and without them the classes of TotalSegmentator's task "total", which are then checked for plausibility.
        body: name of the body's label, or a file with the body on the same grid. The task "total" has no body, so a
            file is needed with it: a mask, or what TotalSegmentator's task "body" writes. A label of the same image is
            taken together with all structures that lie in it, since each voxel of such an image has one label only.
        rigid: names of the rigid parts; by default every bone there is.
        soft: names of further soft tissues inside the body.
        target: the rigid parts that the crop follows; by default the lumbar vertebrae.
        lumbar_only: of the bones only the lumbar vertebrae are rigid, as in the paper.
        layers: take every fat, muscle and disc there is as a soft tissue.

    Raises:
        InputError: a structure is missing, a number has no name, or the image is not a label map.
    """
    image = read_label_image(file)
    given = read_names(names) if isinstance(names, Path | str) else names
    guessed = given is None and not image.names
    table = given or image.names or TOTAL_CLASSES
    counts = _count_labels(image.data)
    present = [int(number) for number in np.flatnonzero(counts) if number != 0]
    for number in present:
        if number not in table:
            raise InputError(
                str(file), expected="labels of the name table only", got=f"label {number} ({counts[number]} voxels)",
                fix="give the table that belongs to this image",
            )
    _refuse_repeated_names(Path(file), [table[number] for number in present])
    numbers = {table[number]: number for number in present}
    body_structure, body_box, body_notes = _body_of_multilabel(Path(file), image, numbers, body)
    soft = with_layers(soft, numbers) if layers else soft
    rigid, targets = choose_bones(
        bones_among(numbers, soft), rigid=rigid, target=target, lumbar_only=lumbar_only,
        where=str(file),
    )
    check_roles(body_structure.name, soft, rigid)
    for name in (*soft, *rigid):
        if name not in table.values():
            raise unknown_structure(name, table.values(), where="the name table")
        if name not in numbers:
            raise _empty(name, Path(file))
    boxes = ndimage.find_objects(image.data)
    seen = look(image.data, image.affine)
    doubts = check_numbering(seen, numbers, file=Path(file)) if guessed else ()
    if not doubts:
        doubts = check_sides({name: seen[number].centre for name, number in numbers.items()})
    read = Segmentation(
        body=body_structure,
        soft=tuple(_label(image, name, numbers[name], boxes) for name in soft),
        rigid=tuple(_label(image, name, numbers[name], boxes) for name in rigid),
        affine=image.affine, shape=_shape(image), notes=(*image.notes, *doubts, *body_notes),
        targets=targets,
    )
    return _on_common_grid(read, [((0, 0, 0), _shape(image)), body_box])


def _centres(structures: Mapping[str, Structure], affine: FloatArray) -> dict[str, FloatArray]:
    return {
        name: (affine @ [*structure.centroid, 1.0])[:3] for name, structure in structures.items() if structure.n_voxels
    }


def _landmarks(folder: Path) -> dict[str, FloatArray]:
    """Centres of one pair of structures of the folder that says where left is [mm]; none without such a pair."""
    found = label_files(folder)
    for name in LANDMARKS:
        pair = [f"{name}_left", f"{name}_right"]
        if all(side in found for side in pair):
            with contextlib.suppress(InputError):  # a file that is not asked for need not be sound
                images = [read_label_image(found[side]) for side in pair]
                seen = [look(image.data, image.affine) for image in images]
                return {
                    side: next(iter(labels.values())).centre for side, labels in zip(pair, seen, strict=True) if labels
                }
    return {}


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
) -> tuple[Structure, tuple[Index3, Index3], tuple[Finding, ...]]:
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
        return Structure.trim(str(body), inside), ((0, 0, 0), _shape(image)), ()
    if not Path(body).is_file():
        raise unknown_structure(str(body), numbers, where=f"{file} or a file")
    other = read_label_image(body)
    mask = replace(other, data=_binary(Path(body), other, body=True))
    labels, corner, placed = on_lattice(body, mask, file, image)
    return Structure.trim("body", labels, corner), (corner, _end(corner, labels)), (*other.notes, *placed)


def _refuse_repeated_names(file: Path, names: Sequence[str]) -> None:
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise InputError(
            str(file), expected="one number a name", got=f"several numbers called {repeated[0]}",
            fix="give --names with a name for each number",
        )


def _end(corner: Index3, labels: AnyArray) -> Index3:
    first, second, third = (c + n for c, n in zip(corner, labels.shape, strict=True))
    return first, second, third


def _on_common_grid(read: Segmentation, boxes: Sequence[tuple[Index3, Index3]]) -> Segmentation:
    """The segmentation on the smallest grid that holds every image it came from."""
    low = np.min([box[0] for box in boxes], axis=0)
    high = np.max([box[1] for box in boxes], axis=0)
    affine = read.affine.copy()
    affine[:3, 3] += affine[:3, :3] @ low

    def moved(structure: Structure) -> Structure:
        first, second, third = (int(c - o) for c, o in zip(structure.corner, low, strict=True))
        return replace(structure, corner=(first, second, third))

    first, second, third = (int(n) for n in high - low)
    return replace(
        read, body=moved(read.body), soft=tuple(map(moved, read.soft)), rigid=tuple(map(moved, read.rigid)),
        affine=affine, shape=(first, second, third),
    )


def _empty(name: str, path: Path) -> InputError:
    return InputError(
        name, expected="at least one voxel", got=f"none in {path}",
        fix="segment the structure again, or leave it out by naming the structures to use",
    )


