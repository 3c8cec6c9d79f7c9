"""Which bones are rigid parts: those of the maps that lie inside the crop, which follows the target."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from mixpinn.anatomy.finding import Finding
from mixpinn.anatomy.names import is_bone, is_lumbar
from mixpinn.anatomy.segmentation import Segmentation, Structure, common_box
from mixpinn.base.errors import InputError

_SMALLEST, _LOWEST = 3000.0, 12.0
"""What is left of a bone inside the crop is a rigid part from this volume [mm³] and height [mm] on."""


def bones_among(names: Iterable[str], soft: Sequence[str]) -> list[str]:
    """Structures that may be rigid by default: those not named as soft tissue, and lumbar vertebrae in any case."""
    return [name for name in names if name not in soft or is_lumbar(name)]


def choose_bones(
    names: Iterable[str], *, rigid: Sequence[str] | None, target: Sequence[str] | None, lumbar_only: bool, where: str,
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Rigid parts and targets among the structures of an image.

    Args:
        names: of all structures.
        rigid: names of the rigid parts; by default every bone there is.
        target: what the crop and the probe positions follow; by default the lumbar vertebrae, and of parts that were
            named without any of these, all.
        lumbar_only: the rigid parts are the lumbar vertebrae alone, as in the paper.
        where: what holds the structures, for the message.

    Returns:
        Names of the rigid parts, and of the targets among them.

    Raises:
        InputError: no lumbar vertebra and nothing named, or a target that is no rigid part.
    """
    names = list(names)
    if rigid is None:
        chosen = [name for name in names if is_lumbar(name) or (is_bone(name) and not lumbar_only)]
        if target is None and not any(map(is_lumbar, chosen)):
            raise InputError(
                where, expected="lumbar vertebrae (vertebrae_L1 …)", got=f"only {', '.join(names) or 'background'}",
                fix="name the rigid parts or the target, or give the table that belongs to this image",
            )
    else:
        chosen = list(rigid)
    if target is None:
        lumbar = tuple(name for name in chosen if is_lumbar(name))
        return tuple(chosen), lumbar or tuple(chosen)
    for name in target:
        if name not in chosen:
            raise InputError(
                f"target {name}", expected="one of the rigid parts: " + ", ".join(chosen), got="another name",
                fix="name a bone of the maps, and with --rigid the target too",
            )
    return tuple(chosen), tuple(target)


def one_sacrum(segmentation: Segmentation) -> Segmentation:
    """The first sacral vertebra and the rest of the sacrum, which are one bone, as one part."""
    parts = {part.name: part for part in segmentation.rigid}
    if not {"sacrum", "vertebrae_S1"} <= set(parts):
        return segmentation
    whole, top = parts["sacrum"], parts["vertebrae_S1"]
    start, stop = common_box(whole, top)
    merged = Structure.trim("sacrum", whole.window(start, stop) | top.window(start, stop), start)
    rigid = tuple(
        merged if part is whole else part for part in segmentation.rigid if part is not top
    )
    note = Finding("part", "vertebrae_S1", "a part of the sacrum: one bone", top.n_voxels, repairable=False)
    targets = tuple("sacrum" if name == "vertebrae_S1" else name for name in segmentation.targets)
    return replace(segmentation, rigid=rigid, notes=(*segmentation.notes, note), targets=tuple(dict.fromkeys(targets)))


def clip_bones(segmentation: Segmentation, low: float, high: float) -> Segmentation:
    """Rigid parts that are no targets, cut to heights low … high [mm]; what is too little to be a part is left out.

    Each gets a note that says what it is taken as and why. Parts that have one keep it, so that a second crop changes
    nothing.
    """
    told = {note.structure for note in segmentation.notes if note.kind == "part"}
    kept: list[Structure] = []
    notes: list[Finding] = []
    cut = list(segmentation.cut)
    spine = int(np.abs(segmentation.affine[2, :3] / segmentation.spacing).argmax())
    volume = float(np.prod(segmentation.spacing))
    whole_sacrum = any(part.name.lower() == "sacrum" for part in segmentation.rigid)
    for part in segmentation.rigid:
        if part.name in segmentation.targets:
            kept.append(part)
            text = "rigid: a target"
        else:
            height = segmentation.heights(part)
            left = Structure.trim(part.name, part.mask & (height >= low) & (height <= high), part.corner)
            lost = part.n_voxels - left.n_voxels
            tall = left.mask.shape[spine] * segmentation.spacing[spine] if left.n_voxels else 0.0
            at_end = bool(left.n_voxels) and any(
                left.corner[axis] == 0 or left.stop[axis] == segmentation.shape[axis] for axis in range(3)
            )
            if not left.n_voxels:
                text = "left out: it lies outside of the crop"
            elif left.n_voxels * volume < _SMALLEST or tall < _LOWEST:
                text = f"soft tissue: only {left.n_voxels * volume / 1e3:.1f} cm³ of it lie in the crop"
            else:
                kept.append(left)
                text = "rigid: a bone inside the crop"
                if part.name.lower() == "vertebrae_s1" and not whole_sacrum:
                    text = "rigid, the top of a sacrum that is not among the maps: it is free to move (--hold holds it)"
                if lost or at_end:
                    cut.append(part.name)
                    what = f"{lost / part.n_voxels:.0%} of it lie outside of the crop" if lost else (
                        "it reaches the image's end"
                    )
                    text = f"rigid, held where it leaves the crop: {what}"
        if part.name not in told:
            notes.append(Finding("part", part.name, text, part.n_voxels, repairable=False))
    return replace(
        segmentation, rigid=tuple(kept), notes=(*segmentation.notes, *notes), cut=tuple(dict.fromkeys(cut)),
    )
