"""Whether the structures of a multi-label image are what the name table calls them: level, size, place on the spine."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import ndimage

from mixpinn.anatomy.finding import Finding
from mixpinn.anatomy.names import TOTAL_CLASSES_V1, is_lumbar, spine_rank
from mixpinn.base.arrays import AnyArray, FloatArray

_ABOVE = re.compile(
    r"(lung|heart|trachea|thyroid|brain|skull|clavicula|scapula|sternum|subclavian|brachiocephalic|common_carotid|"
    r"superior_vena|pulmonary|atrial)|rib_(left|right)_[1-8]$"
)
"""What lies above the lowest lumbar vertebra."""
_BELOW = re.compile(r"(hip|sacrum|vertebrae_S1|urinary_bladder|prostate|gluteus|femur)")
"""What lies below the highest lumbar vertebra."""
_ON_THE_SPINE = ("spinal_cord", "autochthon", "rib")
"""What may lie on the line of the vertebrae without being one."""
_SIDEWAYS, _FORWARD, _LEAST, _MOST = 12.0, 15.0, 0.4, 2.5
"""A structure no farther from the line of the vertebrae [mm], and no smaller or larger than these shares of the nearest
vertebra, looks like a vertebra."""


@dataclass(frozen=True, eq=False)
class Seen:
    """One label of an image: centre in the scanner's RAS frame [mm], size [voxels], whether the image cuts it."""

    centre: FloatArray
    voxels: int
    cut: bool


def check_numbering(seen: Mapping[int, Seen], numbers: Mapping[str, int], *, file: Path) -> tuple[Finding, ...]:
    """Look for signs that the numbers mean something else than the table that was assumed.

    Args:
        seen: every label of the image, see `look`.
        numbers: number of each name that is present.
        file: for the message.

    Returns:
        nothing, or one error with what was seen.
    """
    doubts = list(_doubts({name: seen[number] for name, number in numbers.items() if number in seen}))
    if not doubts:
        return ()
    old = {TOTAL_CLASSES_V1[number]: entry for number, entry in seen.items() if number in TOTAL_CLASSES_V1}
    hint = ""
    if len(old) == len(seen) and any(map(is_lumbar, old)) and not list(_doubts(old)):
        hint = "; read as numbers of TotalSegmentator 1 nothing is odd (--names total-v1)"
    return (Finding("numbering", file.name, "; ".join(doubts[:3]) + hint, 0, repairable=False, error=True),)


def look(labels: AnyArray, affine: FloatArray) -> dict[int, Seen]:
    """Centre and size of every label of an image."""
    seen = {}
    for number, box in enumerate(ndimage.find_objects(labels), start=1):
        if box is None:
            continue
        mask = labels[box] == number
        voxels = int(np.count_nonzero(mask))
        index = np.ones(4)
        for axis in range(3):
            profile = mask.sum(axis=tuple(other for other in range(3) if other != axis))
            index[axis] = box[axis].start + float((profile * np.arange(len(profile))).sum()) / voxels
        cut = any(part.start == 0 or part.stop == n for part, n in zip(box, labels.shape, strict=True))
        seen[number] = Seen((affine @ index)[:3], voxels, cut)
    return seen


def _doubts(seen: Mapping[str, Seen]) -> Iterator[str]:
    lumbar = {name: entry for name, entry in seen.items() if is_lumbar(name)}
    if not lumbar:
        return
    lowest = min(lumbar, key=lambda name: float(lumbar[name].centre[2]))
    highest = max(lumbar, key=lambda name: float(lumbar[name].centre[2]))
    largest = max(lumbar, key=lambda name: lumbar[name].voxels)
    liver, sacrum = seen.get("liver"), seen.get("sacrum")
    if liver is not None and not liver.cut and liver.voxels < 3 * lumbar[largest].voxels:
        yield f"'liver' has {liver.voxels} voxels, {largest} {lumbar[largest].voxels}"
    if sacrum is not None and not sacrum.cut and sacrum.voxels < lumbar[lowest].voxels:
        yield f"'sacrum' has {sacrum.voxels} voxels, {lowest} {lumbar[lowest].voxels}"
    for name, entry in seen.items():
        if _ABOVE.match(name) and entry.centre[2] < lumbar[lowest].centre[2]:
            yield f"'{name}' lies below {lowest}"
        if _BELOW.match(name) and entry.centre[2] > lumbar[highest].centre[2]:
            yield f"'{name}' lies above {highest}"
    yield from _vertebra_like(seen)


def _vertebra_like(seen: Mapping[str, Seen]) -> Iterator[str]:
    """Structures on the line of the vertebrae that are as large as one and bear the name of something else."""
    spine = sorted((entry for name, entry in seen.items() if spine_rank(name) is not None),
                   key=lambda entry: float(entry.centre[2]))
    if len(spine) < 2:
        return
    places = np.array([entry.centre for entry in spine])
    step = float(np.median(np.linalg.norm(np.diff(places, axis=0), axis=1)))
    for name, entry in seen.items():
        if spine_rank(name) is not None or name.startswith(_ON_THE_SPINE):
            continue
        nearest = int(np.argmin(np.abs(places[:, 2] - entry.centre[2])))
        size = entry.voxels / spine[nearest].voxels
        if abs(places[nearest, 2] - entry.centre[2]) > 3.0 * step or not _LEAST <= size <= _MOST:
            continue
        line = [float(np.interp(entry.centre[2], places[:, 2], places[:, axis])) for axis in (0, 1)]
        if abs(entry.centre[0] - line[0]) < _SIDEWAYS and abs(entry.centre[1] - line[1]) < _FORWARD:
            yield f"'{name}' lies on the line of the vertebrae and has {size:.0%} of the size of one"
