"""Does it look like what it is called: lengths, direction, size of each vertebra beside its neighbours."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from mixpinn.anatomy.checks.back import check_back
from mixpinn.anatomy.finding import Finding
from mixpinn.anatomy.names import spine_rank
from mixpinn.anatomy.segmentation import Segmentation, Structure

_UNITS = {"metres": 1e3, "centimetres": 10.0, "inches": 25.4, "tenths of a millimetre": 0.1, "micrometres": 1e-3}
_VERTEBRA, _BODY = (20.0, 250.0), (30.0, 2500.0)
"""Largest extent of a vertebra, and of a body that a probe presses on, from a child to the tallest [mm]."""
_USUAL = {True: (40.0, 130.0), False: (120.0, 2000.0)}
_SMALL, _LARGE = 0.65, 1.5
"""Below and above these shares of its neighbours' volume a vertebra is named."""
_FAR, _CLOSE = 1.6, 0.5
"""Likewise for the step between two vertebrae, of the steps beside it."""
_SKEW, _MIDDLE, _IN_FRONT = 0.02, 0.5, 0.6
"""A vertebra's centre lies in front of the middle of its box; shares of the way from back to front too large for
a spine that is turned, and for any."""


def check_plausible(segmentation: Segmentation) -> tuple[Finding, ...]:
    """Look for what no label check can see in one structure alone; before the repair, and again after it."""
    return (
        *_check_scale(segmentation), *_check_stack(segmentation), *_check_direction(segmentation),
        *check_back(segmentation),
        *_check_sizes(segmentation), *_check_steps(segmentation),
    )


def _finding(kind: str, structure: str, detail: str, *, voxels: int = 0, error: bool = False) -> Finding:
    return Finding(kind, structure, detail, voxels, repairable=False, error=error)  # type: ignore[arg-type]


def _check_scale(segmentation: Segmentation) -> Iterator[Finding]:
    """The vertebra of middle length, and the body: a wrong unit makes all of them wrong by the same factor."""
    spine = sorted((part for part in segmentation.rigid if spine_rank(part.name) is not None and part.n_voxels),
                   key=lambda part: _extent(part, segmentation))
    for structure in (*spine[len(spine) // 2:][:1], segmentation.body):
        vertebra = structure is not segmentation.body
        low, high = _VERTEBRA if vertebra else _BODY
        extent = _extent(structure, segmentation)
        if low <= extent <= high:
            continue
        usual = _USUAL[vertebra]
        unit = next((name for name, factor in _UNITS.items() if usual[0] <= extent * factor <= usual[1]), None)
        guess = f": the lengths look like {unit}" if unit else ""
        yield _finding("scale", structure.name, f"a length of {extent:.3g} mm{guess}", voxels=0, error=True)
        return


def _extent(structure: Structure, segmentation: Segmentation) -> float:
    return float((np.array(structure.mask.shape) * segmentation.spacing).max())


def _check_direction(segmentation: Segmentation) -> Iterator[Finding]:
    """The spine lies behind the middle of the trunk, and its vertebral bodies in front of their processes."""
    spine = [part for part in segmentation.rigid if spine_rank(part.name) is not None and part.n_voxels]
    if not spine:
        return
    axis = int(np.abs(segmentation.affine[1, :3] / segmentation.spacing).argmax())
    forward = float(np.sign(segmentation.affine[1, axis]))
    shares, skews = [], []
    for part in spine:
        start = tuple(0 if k == axis else part.corner[k] for k in range(3))
        stop = tuple(segmentation.shape[k] if k == axis else part.stop[k] for k in range(3))
        used = np.flatnonzero(
            segmentation.body.window((start[0], start[1], start[2]), (stop[0], stop[1], stop[2]))
            .any(axis=tuple(k for k in range(3) if k != axis))
        )
        if len(used) > 1:
            share = (float(part.centroid[axis]) - used[0]) / (used[-1] - used[0])
            shares.append(share if forward > 0 else 1.0 - share)
        middle = 0.5 * (part.corner[axis] + part.stop[axis] - 1)
        skews.append(forward * (float(part.centroid[axis]) - middle) / part.mask.shape[axis])
    turned = float(np.median(skews)) < -_SKEW
    if not shares or float(np.median(shares)) <= (_MIDDLE if turned else _IN_FRONT):
        return
    detail = f"the spine lies in front of the body's middle, {np.median(shares):.0%} of the way from back to front"
    if turned:
        detail += ", with its processes to the front: an LPS matrix written as RAS, left and right exchanged too?"
    yield _finding("direction", segmentation.body.name, detail, error=turned)


def _check_stack(segmentation: Segmentation) -> Iterator[Finding]:
    """Vertebrae follow each other from head to feet, along S, and not across the body."""
    spine = _vertebrae(segmentation)
    if len(spine) < 2:
        return
    first, last = ((segmentation.affine @ [*part.centroid, 1.0])[:3] for _, part in (spine[0], spine[-1]))
    along = np.abs(last - first)
    if along[2] >= np.linalg.norm(along[:2]):
        return
    axis = "left to right" if along[0] > along[1] else "front to back"
    detail = (
        f"the vertebrae from {spine[0][1].name} to {spine[-1][1].name} follow each other from {axis} "
        f"({np.linalg.norm(along[:2]):.0f} mm across, {along[2]:.0f} mm along the body): the axes are exchanged"
    )
    yield _finding("direction", segmentation.body.name, detail, error=True)


def _vertebrae(segmentation: Segmentation) -> list[tuple[int, Structure]]:
    """Thoracic and lumbar vertebrae with their place along the spine, from the head down by name."""
    found = [(spine_rank(part.name), part) for part in segmentation.rigid if part.n_voxels]
    return sorted(((rank, part) for rank, part in found if rank is not None and 100 <= rank < 300),
                  key=lambda entry: entry[0])


def _check_sizes(segmentation: Segmentation) -> Iterator[Finding]:
    spine = _vertebrae(segmentation)
    for index, (rank, part) in enumerate(spine):
        near = [other.n_voxels for at, (_, other) in enumerate(spine) if at != index and abs(at - index) <= 2]
        if near:
            share = part.n_voxels / float(np.median(near))
            if share < _SMALL:
                detail = f"it has {share:.0%} of its neighbours' volume: cut by the image's end, or a part is missing"
                yield _finding("size", part.name, detail, voxels=part.n_voxels)
            elif share > _LARGE:
                detail = f"it has {share:.0%} of its neighbours' volume: it may hold a part of another vertebra"
                yield _finding("size", part.name, detail, voxels=part.n_voxels)
        if rank in (113, 206):
            detail = "a transitional vertebra: the numbers of those below it may be shifted by one"
            yield _finding("missing", part.name, detail)


def _check_steps(segmentation: Segmentation) -> Iterator[Finding]:
    spine = _vertebrae(segmentation)
    centres = [(segmentation.affine @ [*part.centroid, 1.0])[:3] for _, part in spine]
    steps = [float(np.linalg.norm(b - a)) for a, b in pairwise(centres)]
    for index, step in enumerate(steps):
        others = [other for at, other in enumerate(steps) if at != index and abs(at - index) <= 2]
        if not others or spine[index + 1][0] - spine[index][0] not in (1, 89, 88):
            continue  # a gap in the names is said by the order check; T12 or T13 to L1 are 89 and 88
        share = step / max(float(np.median(others)), 1e-9)  # the same mask under two names: no step at all
        pair = f"{spine[index][1].name} and {spine[index + 1][1].name}"
        if share > _FAR:
            detail = f"they lie {step:.0f} mm apart, {share:.1f} times as far as their neighbours: one may be missing"
            yield _finding("missing", pair, detail)
        elif share < _CLOSE:
            detail = f"they lie {step:.0f} mm apart, {share:.1f} times as far as their neighbours: one in two parts?"
            yield _finding("missing", pair, detail)
