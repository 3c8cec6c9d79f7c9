"""The label check: what segmentations get wrong, each finding with its name, size and whether it can be mended."""

from collections.abc import Iterator, Sequence
from itertools import combinations, pairwise

import numpy as np
from scipy import ndimage

from mixpinn.anatomy.finding import Finding
from mixpinn.anatomy.names import spine_rank, vertebrae_between
from mixpinn.anatomy.segmentation import Segmentation, Structure, grown_box
from mixpinn.base.arrays import BoolArray

NEIGHBOURS_26 = np.ones((3, 3, 3), dtype=bool)
"""Voxels that share a face, an edge or a corner."""


def check(segmentation: Segmentation) -> tuple[Finding, ...]:
    """Look for everything in `Finding.kind`, structure by structure; crop first, so that only what is used counts.

    A part counts as inside the body also where the body has a hole for it: masks that leave the bones out are as good.
    """
    solid = solid_body(segmentation)
    return (
        *_check_order(segmentation), *_check_pieces(segmentation), *_check_holes(segmentation, solid),
        *_check_pairs(segmentation), *_check_inside(segmentation, solid), *_check_borders(segmentation),
    )


def largest_component(mask: BoolArray) -> tuple[BoolArray, int]:
    """Largest of the components that hang together by voxel faces, and how many components there are."""
    components, count = ndimage.label(mask)
    if count <= 1:
        return mask, count
    sizes = np.bincount(components.ravel())
    sizes[0] = 0
    largest: BoolArray = components == sizes.argmax()
    return largest, count


def filled(mask: BoolArray) -> BoolArray:
    """The mask with all background that cannot be reached from outside."""
    result: BoolArray = ndimage.binary_fill_holes(mask)
    return result


def solid_body(segmentation: Segmentation) -> Structure:
    """Largest component of the body together with its enclosed background: where parts may lie."""
    body = segmentation.body
    return Structure.trim(body.name, largest_component(filled(body.mask))[0], body.corner)


def touching(first: Structure, second: Structure) -> tuple[int, int]:
    """Voxels of `first` that have a neighbour in `second`: by a face; by a face, edge or corner."""
    start, stop = grown_box(first, 1)
    own, other = first.window(start, stop), second.window(start, stop)
    if not other.any():
        return 0, 0
    by_face = int(np.count_nonzero(own & ndimage.binary_dilation(other)))
    return by_face, int(np.count_nonzero(own & ndimage.binary_dilation(other, NEIGHBOURS_26)))


def shared(first: Structure, second: Structure) -> BoolArray:
    """Voxels that both have, on the box of `first`."""
    both: BoolArray = first.mask & second.window(*first.box)
    return both


def exposed(part: Structure, solid: Structure) -> BoolArray:
    """Voxels of the part that are outside the body or have a neighbour there, on the box of `part`."""
    start, stop = grown_box(part, 1)
    inner = ndimage.binary_erosion(solid.window(start, stop), NEIGHBOURS_26)
    result: BoolArray = part.mask & ~inner[1:-1, 1:-1, 1:-1]
    return result


def spine_order(segmentation: Segmentation) -> tuple[list[Structure], list[str]]:
    """Vertebrae from the head down by position, and their names in the order they should have."""
    named = [part for part in segmentation.rigid if spine_rank(part.name) is not None and part.n_voxels]
    by_place = sorted(named, key=lambda part: -float((segmentation.affine[:3] @ [*part.centroid, 1.0])[2]))
    return by_place, sorted((part.name for part in named), key=lambda name: spine_rank(name) or 0)


def is_upside_down(found: Sequence[str], right: Sequence[str]) -> bool:
    """Whether three vertebrae or more come in exactly the reverse order: the image is wrong then, not the names."""
    return len(found) >= 3 and list(found) == list(right)[::-1]


def _check_order(segmentation: Segmentation) -> Iterator[Finding]:
    by_place, right = spine_order(segmentation)
    found = [part.name for part in by_place]
    if found != right:
        reverse = is_upside_down(found, right)
        wrong = sum(part.n_voxels for part, name in zip(by_place, right, strict=True) if part.name != name)
        pair, detail = " and ".join(right[:: len(right) - 1]), f"from the head down they are {', '.join(found)}"
        if reverse:  # turned or mirrored: whichever it is, left and right of the image are in doubt
            detail += ": the image is upside down, so that left may be right"
            yield Finding("direction", pair, detail, wrong, repairable=False, error=True)
        else:
            yield Finding("order", pair, detail, wrong)
    ranks = [spine_rank(name) or 0 for name in right]
    for (upper, first), (lower, second) in pairwise(zip(right, ranks, strict=True)):
        if vertebrae_between(first, second):
            yield Finding("order", f"{upper} and {lower}", "a vertebra between them is left out", 0, repairable=False)


def _check_pieces(segmentation: Segmentation) -> Iterator[Finding]:
    for structure in (segmentation.body, *segmentation.parts):
        largest, count = largest_component(structure.mask)
        if count > 1:
            voxels = structure.n_voxels - int(np.count_nonzero(largest))
            noun = "piece" if count == 2 else "pieces"
            yield Finding("island", structure.name, f"{count - 1} {noun} ({voxels} voxels) beside the largest", voxels)


def _check_holes(segmentation: Segmentation, solid: Structure) -> Iterator[Finding]:
    body = segmentation.body
    empty = solid.mask & ~body.window(*solid.box)
    if empty.any():
        for part in segmentation.parts:
            empty &= ~part.window(*solid.box)
    voxels = int(np.count_nonzero(empty))
    if voxels:
        hollow = 2 * voxels > solid.n_voxels  # a skin, not a body
        yield Finding("hole", body.name, f"{voxels} voxels of enclosed background", voxels, error=hollow)
    for part in segmentation.parts:
        voxels = int(np.count_nonzero(filled(part.mask) & ~part.mask))
        if voxels:
            yield Finding("hole", part.name, f"{voxels} enclosed voxels that are not its own", voxels)


def _check_pairs(segmentation: Segmentation) -> Iterator[Finding]:
    rigid = {part.name for part in segmentation.rigid}
    for first, second in combinations(segmentation.parts, 2):
        both, pair = int(np.count_nonzero(shared(first, second))), f"{first.name} and {second.name}"
        if both:
            whole = both == min(first.n_voxels, second.n_voxels) and (first.name in rigid) == (second.name in rigid)
            yield Finding("overlap", pair, f"{both} shared voxels", both, repairable=not whole, error=True)
        elif {first.name, second.name} <= rigid:
            by_face, by_any = touching(first, second)
            if by_any:
                detail = f"{by_any} adjacent voxels ({by_face} face to face)"
                yield Finding("touch", pair, detail, by_any)


def _check_inside(segmentation: Segmentation, solid: Structure) -> Iterator[Finding]:
    rigid = {part.name for part in segmentation.rigid}
    for part in segmentation.parts:
        voxels = int(np.count_nonzero(part.mask & ~solid.window(*part.box)))
        if voxels:
            whole = voxels == part.n_voxels
            detail = "all of it outside" if whole else f"{voxels} of {part.n_voxels} voxels outside"
            yield Finding("outside", part.name, detail, voxels, repairable=not whole, error=whole or part.name in rigid)
        elif part.name in rigid:
            voxels = int(np.count_nonzero(exposed(part, solid)))
            if voxels:
                yield Finding("exposed", part.name, f"{voxels} voxels at the body's surface", voxels)


def _check_borders(segmentation: Segmentation) -> Iterator[Finding]:
    # The body runs through the image from end to end along the spine: only its sides are looked at.
    spine_axis = int(np.abs(segmentation.affine[2, :3] / segmentation.spacing).argmax())
    for structure in (segmentation.body, *segmentation.parts):
        voxels = 0
        for axis in range(3):
            if structure.name != segmentation.body.name or axis != spine_axis:
                faces = np.moveaxis(structure.mask, axis, 0)
                voxels += int(np.count_nonzero(faces[0])) if structure.corner[axis] == 0 else 0
                voxels += int(np.count_nonzero(faces[-1])) if structure.stop[axis] == segmentation.shape[axis] else 0
        if voxels:
            yield Finding("cut off", structure.name, f"{voxels} voxels at the image's border", voxels, repairable=False)


