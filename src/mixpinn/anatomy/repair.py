"""Repair of what the label check finds, on request; every change is reported."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import combinations

import numpy as np
from scipy import ndimage

from mixpinn.anatomy.checks.labels import (
    NEIGHBOURS_26,
    exposed,
    filled,
    is_upside_down,
    largest_component,
    shared,
    solid_body,
    spine_order,
    touching,
)
from mixpinn.anatomy.finding import Finding, Kind
from mixpinn.anatomy.segmentation import Segmentation, Structure, common_box, grown_box
from mixpinn.base.arrays import BoolArray, FloatArray
from mixpinn.base.errors import InputError

Change = tuple[Segmentation, Finding]
Step = Callable[[Segmentation], Iterator[Change]]


def repair(segmentation: Segmentation) -> tuple[Segmentation, tuple[Finding, ...]]:
    """Mend what can be mended, in this order, and report each change as a repaired finding.

    1. *order*: vertebrae are renamed by their place along the spine (not where the whole order is reversed: then the
       image is upside down, which no renaming mends).
    2. *overlap*: a voxel of two rigid parts, or of two soft tissues, goes to the one whose voxels of its own are
       nearest (millimetres between voxel centres; in a tie to the one named first); rigid wins over soft.
    3. *island*: the largest component is kept.
    4. *hole*: enclosed background is filled.
    5. *outside* and *exposed*: voxels outside the body, then those next to background by face, edge or corner, are
       taken away from the part, so that at least one voxel of soft tissue covers it.
    6. *touch*: of two rigid parts that touch, the one with more voxels gives up those adjacent to the other by face,
       edge or corner: a gap of one voxel. Pieces that this cuts off are removed like islands.

    Raises:
        InputError: nothing would be left of a structure.
    """
    reports: list[Finding] = []
    steps: tuple[Step, ...] = (
        _rename, _resolve_overlaps, _drop_islands, _fill_holes, _clip_to_body, _separate, _drop_islands,
    )
    for step in steps:
        for changed, report in step(segmentation):  # each change is made to the one before
            segmentation = changed
            reports.append(report)
        for structure in (segmentation.body, *segmentation.parts):
            if structure.n_voxels == 0:
                raise InputError(
                    structure.name, expected="voxels left after the repair", got="none",
                    fix="segment it again or leave it out",
                )
    return segmentation, tuple(reports)


def _report(kind: Kind, structure: str, detail: str, voxels: int) -> Finding:
    return Finding(kind, structure, detail, voxels, repaired=True)


def _masked(structure: Structure, mask: BoolArray) -> Structure:
    return Structure.trim(structure.name, mask, structure.corner)


def _rename(segmentation: Segmentation) -> Iterator[Change]:
    by_place, right = spine_order(segmentation)
    found = [part.name for part in by_place]
    if found == right or is_upside_down(found, right):
        return
    new_names = dict(zip(found, right, strict=True))
    rigid = tuple(replace(part, name=new_names.get(part.name, part.name)) for part in segmentation.rigid)
    segmentation = replace(segmentation, rigid=rigid)
    changed = [(old, new) for old, new in new_names.items() if old != new]
    voxels = sum(part.n_voxels for part in by_place if new_names[part.name] != part.name)
    detail = "renamed " + ", ".join(f"{old} to {new}" for old, new in changed)
    yield segmentation, _report("order", " and ".join(old for old, _ in changed), detail, voxels)


def _resolve_overlaps(segmentation: Segmentation) -> Iterator[Change]:
    rigid = {part.name for part in segmentation.rigid}
    names = [part.name for part in segmentation.parts]
    for first_name, second_name in combinations(names, 2):
        parts = {part.name: part for part in segmentation.parts}
        first, second = parts[first_name], parts[second_name]
        both = int(np.count_nonzero(shared(first, second)))
        if not both:
            continue
        if (first_name in rigid) != (second_name in rigid):
            soft = first if second_name in rigid else second
            hard = second if soft is first else first
            segmentation = segmentation.with_part(_masked(soft, soft.mask & ~hard.window(*soft.box)))
            detail = f"{both} shared voxels kept by {hard.name}"
        else:
            start, stop = common_box(first, second)
            a, b = first.window(start, stop), second.window(start, stop)
            to_first = _distance(a & ~b, segmentation) <= _distance(b & ~a, segmentation)
            segmentation = segmentation.with_part(Structure.trim(first_name, a & (~b | to_first), start))
            segmentation = segmentation.with_part(Structure.trim(second_name, b & ~(a & to_first), start))
            detail = f"{both} shared voxels given to the nearer structure"
        yield segmentation, _report("overlap", f"{first_name} and {second_name}", detail, both)


def _distance(mask: BoolArray, segmentation: Segmentation) -> FloatArray:
    """Distance of each voxel to the nearest of `mask` [mm]; infinite where there is none."""
    if not mask.any():
        return np.full(mask.shape, np.inf)
    distance: FloatArray = ndimage.distance_transform_edt(~mask, sampling=segmentation.spacing)
    return distance


def _drop_islands(segmentation: Segmentation) -> Iterator[Change]:
    for structure in (segmentation.body, *segmentation.parts):
        largest, count = largest_component(structure.mask)
        if count > 1:
            lost = structure.n_voxels - int(np.count_nonzero(largest))
            segmentation = segmentation.with_part(_masked(structure, largest))
            detail = f"{count - 1} smaller {'piece' if count == 2 else 'pieces'} ({lost} voxels) removed"
            yield segmentation, _report("island", structure.name, detail, lost)


def _fill_holes(segmentation: Segmentation) -> Iterator[Change]:
    for structure in (segmentation.body, *segmentation.parts):
        holes = filled(structure.mask) & ~structure.mask
        if structure.name != segmentation.body.name:
            for other in segmentation.parts:  # what another part holds is no hole
                holes &= ~other.window(*structure.box)
        gained = int(np.count_nonzero(holes))
        if gained:
            segmentation = segmentation.with_part(_masked(structure, structure.mask | holes))
            yield segmentation, _report("hole", structure.name, f"{gained} enclosed voxels filled", gained)


def _clip_to_body(segmentation: Segmentation) -> Iterator[Change]:
    solid = solid_body(segmentation)
    for part in segmentation.parts:
        outside = part.mask & ~solid.window(*part.box)
        lost = int(np.count_nonzero(outside))
        if lost:
            part = _masked(part, part.mask & ~outside)
            segmentation = segmentation.with_part(part)
            yield segmentation, _report("outside", part.name, f"{lost} voxels outside the body removed", lost)
    for part in segmentation.rigid:
        if part.n_voxels == 0:
            continue
        bare = exposed(part, solid)
        lost = int(np.count_nonzero(bare))
        if lost:
            segmentation = segmentation.with_part(_masked(part, part.mask & ~bare))
            yield segmentation, _report("exposed", part.name, f"{lost} voxels at the surface became soft", lost)


def _separate(segmentation: Segmentation) -> Iterator[Change]:
    for first_name, second_name in combinations([part.name for part in segmentation.rigid], 2):
        parts = {part.name: part for part in segmentation.rigid}
        first, second = parts[first_name], parts[second_name]
        if not touching(first, second)[1]:
            continue
        larger, smaller = (first, second) if first.n_voxels >= second.n_voxels else (second, first)
        start, stop = grown_box(larger, 1)
        near = ndimage.binary_dilation(smaller.window(start, stop), NEIGHBOURS_26)[1:-1, 1:-1, 1:-1]
        lost = int(np.count_nonzero(larger.mask & near))
        segmentation = segmentation.with_part(_masked(larger, larger.mask & ~near))
        detail = f"{lost} voxels of {larger.name} became soft: a gap of one voxel"
        yield segmentation, _report("touch", f"{first_name} and {second_name}", detail, lost)
