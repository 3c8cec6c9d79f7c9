"""What the probe would press on: the skin of the back over the rigid parts, not a cut, not the table."""

from collections.abc import Iterator

import numpy as np

from mixpinn.anatomy.finding import Finding
from mixpinn.anatomy.segmentation import Segmentation
from mixpinn.base.arrays import AnyArray, BoolArray, FloatArray

_BESIDE, _BROAD = 30.0, 120.0
"""How far beside the rigid parts the skin is looked at, for cuts and for the table [mm]."""
_CUT, _ROUND, _TWICE, _NECK = 0.35, 0.5, 0.02, 0.85
"""From this share of the columns on the back counts as cut off; lies on the circle of the reconstruction; is met twice
along the same line from the front; and narrower than so much of what lies behind it a layer is a neck."""
_FEWEST = 64
"""An image with fewer voxels across is none of a whole reconstruction."""


def check_back(segmentation: Segmentation) -> Iterator[Finding]:
    """Look at the back as the probe meets it, from behind.

    Yields an error where the image's border cuts the back off over the rigid parts, warnings where it touches it,
    where the back follows the circle of the reconstruction, and where something lies behind the back.
    """
    name = segmentation.body.name
    body, _ = _seen_from_behind(segmentation, _BESIDE)
    columns = body.any(axis=0)
    count = int(np.count_nonzero(columns))
    if not count:
        return
    first = body.argmax(axis=0)
    cut = int(np.count_nonzero(columns & (first == 0)))
    if cut:
        share = cut / count
        detail = (
            f"the back, the side that is pressed, is cut off by the field of view over {share:.0%} of the rigid parts"
        )
        yield Finding("cut off", name, detail, cut, repairable=False, error=share >= _CUT)
    elif (share := _on_circle(segmentation)) >= _ROUND:
        detail = (
            f"the back, the side that is pressed, follows the circle of the reconstruction over {share:.0%} of the "
            "rigid parts: it may be cut off by the field of view"
        )
        yield Finding("cut off", name, detail, count, repairable=False)
    yield from _check_table(segmentation)


def _axes(segmentation: Segmentation) -> tuple[int, int, int, bool]:
    """Grid axes along A, R and S, and whether the first runs from back to front."""
    direction = np.abs(segmentation.affine[:3, :3] / segmentation.spacing)
    a = int(direction[1].argmax())
    s = max((k for k in range(3) if k != a), key=lambda k: float(direction[2, k]))
    return a, 3 - a - s, s, bool(segmentation.affine[1, a] > 0.0)


def _seen_from_behind(segmentation: Segmentation, beside: float) -> tuple[BoolArray, FloatArray]:
    """The body around the rigid parts with axes (from the back, R, S), and their voxel sizes [mm]."""
    a, r, s, to_front = _axes(segmentation)
    low = np.min([part.corner for part in segmentation.rigid], axis=0)
    high = np.max([part.stop for part in segmentation.rigid], axis=0)
    by = round(beside / float(segmentation.spacing[r]))
    start, stop = list(low), list(high)
    start[a], stop[a] = 0, segmentation.shape[a]
    start[r], stop[r] = max(0, low[r] - by), min(segmentation.shape[r], high[r] + by)
    window = segmentation.body.window(
        (int(start[0]), int(start[1]), int(start[2])), (int(stop[0]), int(stop[1]), int(stop[2])),
    )
    view = np.moveaxis(window, (a, r, s), (0, 1, 2))
    return (view if to_front else view[::-1]), segmentation.spacing[[a, r, s]]


def _on_circle(segmentation: Segmentation) -> float:
    """Share of the columns over the rigid parts whose skin lies on the circle that the image's sides enclose."""
    a, r, _, _ = _axes(segmentation)
    if min(segmentation.shape[a], segmentation.shape[r]) < _FEWEST:
        return 0.0
    body, sizes = _seen_from_behind(segmentation, _BESIDE)
    low = np.min([part.corner for part in segmentation.rigid], axis=0)
    columns = body.any(axis=0)
    start = max(0, int(low[r]) - round(_BESIDE / float(sizes[1])))
    across = (start + np.arange(body.shape[1]) - 0.5 * (segmentation.shape[r] - 1)) * sizes[1]
    depth = (body.argmax(axis=0) - 0.5 * (segmentation.shape[a] - 1)) * sizes[0]
    radius = 0.5 * min(segmentation.shape[a] * float(sizes[0]), segmentation.shape[r] * float(sizes[1]))
    near = np.abs(np.hypot(across[:, None], depth) - radius) <= 2.0 * float(sizes[:2].max())
    return float(np.count_nonzero(near & columns)) / max(int(np.count_nonzero(columns)), 1)


def _check_table(segmentation: Segmentation) -> Iterator[Finding]:
    a, _, _, to_front = _axes(segmentation)
    body, _ = _seen_from_behind(segmentation, _BROAD)
    middle = float(np.mean([part.centroid[a] for part in segmentation.rigid]))
    end = round(middle if to_front else segmentation.shape[a] - 1 - middle)
    behind = body[: max(end, 2)]
    columns = behind.any(axis=0)
    count = int(np.count_nonzero(columns))
    entries = behind[0].astype(np.int64) + (behind[1:] & ~behind[:-1]).sum(axis=0)
    twice = int(np.count_nonzero(entries > 1))
    if twice > _TWICE * count or _has_neck(behind):
        detail = f"something lies behind the back ({twice} of {count} lines from behind meet the body twice): a table?"
        yield Finding("table", segmentation.body.name, detail, twice, repairable=False)


def _has_neck(behind: AnyArray) -> bool:
    """Whether the body, seen layer by layer from behind, is broad, then narrower, then broad again."""
    width = behind.any(axis=2).sum(axis=1)
    broadest = 0
    for layer, columns in enumerate(width):
        if columns < _NECK * broadest and width[layer:].max() > columns:
            return True
        broadest = max(broadest, int(columns))
    return False
