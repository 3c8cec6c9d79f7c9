"""One parametric lumbar vertebra: body, pedicles, laminae, spinous and transverse processes."""

from dataclasses import dataclass

import numpy as np

from mixpinn.anatomy.checks.labels import largest_component
from mixpinn.anatomy.segmentation import Structure
from mixpinn.base.arrays import BoolArray, FloatArray


@dataclass(frozen=True)
class VertebraShape:
    """Dimensions of a vertebra [mm]; the defaults are those of an adult's lumbar spine.

    Attributes:
        body_width, body_depth, body_height: vertebral body, left to right, front to back, top to bottom.
        body_waist: how much less wide and deep the vertebral body is at half its height.
        canal_width, canal_depth: the spinal canal behind it.
        pedicle_width, pedicle_height: the two bridges beside the canal.
        lamina_thickness, lamina_height: the two plates that close the canal behind.
        spinous_reach: from the front of the body to the tip of the spinous process.
        spinous_width, spinous_height: the spinous process, a blade.
        spinous_drop: how far its tip lies below its root.
        transverse_span: from tip to tip of the transverse processes.
        transverse_thickness: their diameter.
    """

    body_width: float = 45.0
    body_depth: float = 33.0
    body_height: float = 27.0
    body_waist: float = 2.5
    canal_width: float = 22.0
    canal_depth: float = 16.0
    pedicle_width: float = 9.0
    pedicle_height: float = 14.0
    lamina_thickness: float = 7.0
    lamina_height: float = 18.0
    spinous_reach: float = 78.0
    spinous_width: float = 8.0
    spinous_height: float = 19.0
    spinous_drop: float = 5.0
    transverse_span: float = 88.0
    transverse_thickness: float = 9.0

    @property
    def tip_behind_centre(self) -> float:
        """From the centre of the vertebral body to the tip of the spinous process [mm]."""
        return self.spinous_reach - 0.5 * self.body_depth


def paint_vertebra(
    name: str, shape: VertebraShape, axes: tuple[FloatArray, FloatArray, FloatArray], *,
    centre: tuple[float, float, float], tilt: float,
) -> Structure:
    """Voxels of a vertebra on a grid.

    Args:
        name: of the structure.
        shape: its dimensions.
        axes: coordinates of the voxel centres to the right, to the back and downward [mm].
        centre: of the vertebral body on these axes [mm].
        tilt: turn about the axis to the right that moves its lower end backward [radian].
    """
    reach = np.array([
        0.5 * max(shape.transverse_span, shape.body_width), shape.tip_behind_centre + shape.body_depth,
        shape.tip_behind_centre + shape.body_height,
    ]) + shape.lamina_height
    near = [np.flatnonzero(np.abs(axis - c) <= r) for axis, c, r in zip(axes, centre, reach, strict=True)]
    x, y, z = np.meshgrid(*[axis[i] - c for axis, i, c in zip(axes, near, centre, strict=True)], indexing="ij",
                          sparse=True)
    # The vertebra's own axes: b to its back, d down along the spine.
    b, d = np.cos(tilt) * y - np.sin(tilt) * z, np.sin(tilt) * y + np.cos(tilt) * z
    # A tip thinner than a voxel may come apart from the rest.
    mask, _ = largest_component(_inside(shape, np.abs(x), b, d))
    return Structure.trim(name, mask, (int(near[0][0]), int(near[1][0]), int(near[2][0])))


def _inside(shape: VertebraShape, x: FloatArray, b: FloatArray, d: FloatArray) -> BoolArray:
    """Whether points (|right|, back, down) from the centre of the vertebral body [mm] belong to the vertebra."""
    half_height = 0.5 * shape.body_height
    waist = shape.body_waist * (1.0 - np.minimum(np.abs(d) / half_height, 1.0) ** 2)
    width, depth = np.maximum(shape.body_width - waist, 1e-9), np.maximum(shape.body_depth - waist, 1e-9)
    body = (np.abs(d) <= half_height) & ((2.0 * x / width) ** 2 + (2.0 * b / depth) ** 2 <= 1.0)

    wall = 0.5 * shape.body_depth  # the canal begins behind the body
    canal_middle, canal_end = wall + 0.5 * shape.canal_depth, wall + shape.canal_depth
    canal = (2.0 * x / shape.canal_width) ** 2 + (2.0 * (b - canal_middle) / shape.canal_depth) ** 2 < 1.0

    side = 0.5 * (shape.canal_width + shape.pedicle_width)  # middle of a pedicle
    high = -0.2 * shape.body_height  # pedicles spring from the upper half of the body
    corner = canal_middle + 0.25 * shape.canal_depth  # where pedicle, lamina and transverse process meet
    pedicle = (
        (np.abs(x - side) <= 0.5 * shape.pedicle_width) & (b >= 0.25 * shape.body_depth) & (b <= corner)
        & (np.abs(d - high) <= 0.5 * shape.pedicle_height)
    )
    behind = canal_end + 0.5 * shape.lamina_thickness
    lamina = (_to_segment((x, b), (side, corner), (0.0, behind)) <= 0.5 * shape.lamina_thickness) & (
        np.abs(d - 0.1 * shape.body_height) <= 0.5 * shape.lamina_height
    )

    tip = shape.tip_behind_centre
    along = np.clip((b - canal_end) / max(tip - canal_end, 1e-9), 0.0, 1.0)
    middle = 0.1 * shape.body_height + shape.spinous_drop * along
    rounding = np.sqrt(np.clip((tip - b) / (0.3 * shape.spinous_height), 0.0, 1.0))  # of the blade's hind edge
    spinous = (
        (x <= 0.5 * shape.spinous_width) & (b >= canal_end) & (b <= tip)
        & (np.abs(d - middle) <= 0.5 * shape.spinous_height * rounding)
    )

    radius = 0.5 * shape.transverse_thickness
    end = 0.5 * shape.transverse_span - radius
    transverse = _to_segment((x, b, d), (side, corner, high), (end, corner + 4.0, high + 2.0)) <= radius

    mask: BoolArray = body | ((pedicle | lamina | spinous | transverse) & ~canal)
    return mask


def _to_segment(
    point: tuple[FloatArray, ...], start: tuple[float, ...], end: tuple[float, ...],
) -> FloatArray:
    """Distance of points from the segment between start and end [mm]."""
    length = sum((e - s) ** 2 for s, e in zip(start, end, strict=True))
    along = np.clip(
        sum((p - s) * (e - s) for p, s, e in zip(point, start, end, strict=True)) / max(length, 1e-12), 0.0, 1.0,
    )
    square = sum((p - s - along * (e - s)) ** 2 for p, s, e in zip(point, start, end, strict=True))
    distance: FloatArray = np.sqrt(square)
    return distance
