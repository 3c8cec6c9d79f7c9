"""The built-in lumbar phantom: an elliptic torso with parametric vertebrae along a lordotic curve."""

from dataclasses import dataclass, field, fields, replace
from itertools import pairwise

import numpy as np
from scipy import ndimage

from mixpinn.anatomy.crop import crop, place_in_frame
from mixpinn.anatomy.segmentation import Segmentation, Structure, grown_box
from mixpinn.anatomy.vertebra import VertebraShape, paint_vertebra
from mixpinn.base.arrays import FloatArray
from mixpinn.base.errors import InputError
from mixpinn.records.label_map import SCANNER_TO_WORLD, LabelMap
from mixpinn.records.voxels import check_extents

NAMES = (*(f"vertebrae_T{number}" for number in range(1, 13)), *(f"vertebrae_L{number}" for number in range(1, 6)))
MINIMUM_GAP = 2
"""Voxels of soft tissue between neighbouring vertebrae, at least."""


@dataclass(frozen=True)
class PhantomConfig:
    """All dimensions of the phantom; the defaults are an adult's.

    Attributes:
        vertebrae: how many: up to five are L1, L2, …; more begin above, at T12, T11, …
        voxel_size: edge of a voxel [mm].
        torso_width, torso_depth: axes of the torso's ellipse, left to right and front to back [mm].
        tissue_behind_spine: from the hindmost spinous process to the skin of the back [mm].
        disc_height: between vertebral bodies, along the spine [mm].
        lordosis: bending of the spine a level, hollow towards the back [degree].
        caudal_growth: how much wider and deeper the lowest vertebra is than the highest, relative.
        above, below: torso beyond the highest and lowest vertebra [mm]; the crop takes what it needs of it.
        variation: relative standard deviation of the dimensions where a generator is given.
        vertebra: dimensions of the middle vertebra.
    """

    vertebrae: int = 5
    voxel_size: float = 2.0
    torso_width: float = 300.0
    torso_depth: float = 220.0
    tissue_behind_spine: float = 25.0
    disc_height: float = 10.0
    lordosis: float = 9.0
    caudal_growth: float = 0.1
    above: float = 70.0
    below: float = 55.0
    variation: float = 0.04
    vertebra: VertebraShape = field(default_factory=VertebraShape)


TINY_PHANTOM = PhantomConfig(
    vertebrae=2, voxel_size=4.0, torso_width=180.0, torso_depth=140.0, tissue_behind_spine=24.0, disc_height=16.0,
    lordosis=4.0, above=24.0, below=24.0, vertebra=VertebraShape(body_waist=0.0),
)
"""Two vertebrae in a small torso of coarse voxels: for trials and tests."""


def make_phantom(config: PhantomConfig | None = None, *, rng: np.random.Generator | None = None) -> LabelMap:
    """Build the phantom, cropped and placed like any other anatomy.

    Args:
        config: its dimensions.
        rng: varies torso, curve and each vertebra; without it the phantom is exactly the configured one.

    Raises:
        InputError: the dimensions make no phantom: not positive, vertebrae that meet, or that leave the torso.
    """
    return replace(place_in_frame(crop(phantom_segmentation(config, rng=rng))), phantom=True)


def tiny_phantom() -> LabelMap:
    """The phantom of `TINY_PHANTOM`."""
    return make_phantom(TINY_PHANTOM)


def phantom_segmentation(
    config: PhantomConfig | None = None, *, rng: np.random.Generator | None = None,
) -> Segmentation:
    """The phantom before crop and frame, see `make_phantom`."""
    config = config or PhantomConfig()
    _validate(config)
    shapes = _shapes(config, rng)
    if rng is not None:
        config = _vary(config, rng, ("torso_width", "torso_depth", "tissue_behind_spine", "lordosis"))
    centres, tilts = _curve(config, shapes)
    tips = centres[:, 0] + [shape.tip_behind_centre * np.cos(tilt) for shape, tilt in zip(shapes, tilts, strict=True)]

    # Grid in the world's axes, x to the right, y to the back, z down; the spine's first centre is at y = z = 0.
    size = config.voxel_size
    back = float(np.max(tips)) + config.tissue_behind_spine
    low = np.array([-0.5 * config.torso_width, back - config.torso_depth,
                    centres[0, 1] - 0.5 * shapes[0].body_height - config.above]) - 2.0 * size
    high = np.array([0.5 * config.torso_width, back,
                     centres[-1, 1] + 0.5 * shapes[-1].body_height + config.below]) + 2.0 * size
    counts = np.ceil((high - low) / size).astype(int)
    check_extents(counts.tolist(), 1, "phantom")
    x, y, z = (low[axis] + size * (np.arange(counts[axis]) + 0.5) for axis in range(3))
    middle = back - 0.5 * config.torso_depth
    ellipse = (2.0 * x[:, None] / config.torso_width) ** 2 + (2.0 * (y - middle) / config.torso_depth) ** 2 <= 1.0
    body = np.broadcast_to(ellipse[:, :, None], tuple(counts))

    first = max(0, len(NAMES) - max(5, config.vertebrae))
    names = NAMES[first: first + config.vertebrae]
    rigid = [
        paint_vertebra(name, shape, (x, y, z), centre=(0.0, centre[0], centre[1]), tilt=tilt)
        for name, shape, centre, tilt in zip(names, shapes, centres, tilts, strict=True)
    ]
    _check_gaps(rigid)
    for part in rigid:
        if (part.mask & ~body[tuple(slice(a, b) for a, b in zip(*part.box, strict=True))]).any():
            raise InputError("phantom", expected="vertebrae inside the torso", got=f"{part.name} sticking out",
                             fix="make the torso larger")
    grid_to_world = np.diag([size, size, size, 1.0])
    grid_to_world[:3, 3] = [x[0], y[0], z[0]]
    return Segmentation(
        body=Structure.trim("body", body), soft=(), rigid=tuple(rigid),
        affine=np.linalg.inv(SCANNER_TO_WORLD) @ grid_to_world, shape=(int(counts[0]), int(counts[1]), int(counts[2])),
    )


def _curve(config: PhantomConfig, shapes: list[VertebraShape]) -> tuple[FloatArray, FloatArray]:
    """Centres (y, z) [mm] of the vertebral bodies, shape (v, 2), and their tilts [radian], shape (v,).

    The spine's tangent turns at a constant rate, (dy, dz)/ds = (sin θ, cos θ): forward above, backward below.
    """
    count = len(shapes)
    tilts = np.deg2rad(config.lordosis) * (np.arange(count) - 0.5 * (count - 1))
    centres = np.zeros((count, 2))
    for i in range(1, count):
        step = 0.5 * (shapes[i - 1].body_height + shapes[i].body_height) + config.disc_height
        angle = 0.5 * (tilts[i - 1] + tilts[i])
        centres[i] = centres[i - 1] + step * np.array([np.sin(angle), np.cos(angle)])
    return centres, tilts


def _shapes(config: PhantomConfig, rng: np.random.Generator | None) -> list[VertebraShape]:
    offsets = np.linspace(-0.5, 0.5, config.vertebrae) if config.vertebrae > 1 else np.zeros(1)
    shapes = []
    for offset in offsets:
        scale = 1.0 + config.caudal_growth * float(offset)
        middle = config.vertebra
        shape = replace(middle, body_width=middle.body_width * scale, body_depth=middle.body_depth * scale)
        shapes.append(shape if rng is None else _vary_shape(shape, rng, config.variation))
    return shapes


def _factor(rng: np.random.Generator, spread: float) -> float:
    return 1.0 + spread * float(np.clip(rng.standard_normal(), -2.0, 2.0))


def _vary(config: PhantomConfig, rng: np.random.Generator, names: tuple[str, ...]) -> PhantomConfig:
    values = {name: getattr(config, name) * _factor(rng, config.variation) for name in names}
    return replace(config, **values)


def _vary_shape(shape: VertebraShape, rng: np.random.Generator, spread: float) -> VertebraShape:
    values = {entry.name: getattr(shape, entry.name) * _factor(rng, spread) for entry in fields(shape)}
    return replace(shape, **values)


def _validate(config: PhantomConfig) -> None:
    def refuse(name: str, expected: str, got: object) -> InputError:
        return InputError(f"phantom.{name}", expected=expected, got=str(got), fix="correct the setting")

    if not 1 <= config.vertebrae <= len(NAMES):
        raise refuse("vertebrae", f"1 to {len(NAMES)}", config.vertebrae)
    for name in ("voxel_size", "torso_width", "torso_depth", "tissue_behind_spine", "disc_height"):
        if not 0.0 < getattr(config, name) < np.inf:
            raise refuse(name, "a positive length", getattr(config, name))
    for name in ("above", "below"):
        if not 0.0 <= getattr(config, name) < np.inf:
            raise refuse(name, "0 mm or more", getattr(config, name))
    for name, limit in (("lordosis", 30.0), ("caudal_growth", 0.9)):
        if not abs(getattr(config, name)) <= limit:
            raise refuse(name, f"at most {limit:g} either way", getattr(config, name))
    if not 0.0 <= config.variation <= 0.2:
        raise refuse("variation", "0 to 0.2", config.variation)
    for entry in fields(config.vertebra):
        length = getattr(config.vertebra, entry.name)
        if not (0.0 < length < np.inf or (length == 0.0 and entry.name in ("body_waist", "spinous_drop"))):
            raise refuse(f"vertebra.{entry.name}", "a positive length", length)


def _check_gaps(parts: list[Structure]) -> None:
    cube = np.ones([2 * MINIMUM_GAP + 1] * 3, dtype=bool)
    for upper, lower in pairwise(parts):
        start, stop = grown_box(upper, MINIMUM_GAP)
        if (ndimage.binary_dilation(upper.window(start, stop), cube) & lower.window(start, stop)).any():
            raise InputError(
                "phantom", expected=f"{MINIMUM_GAP} voxels between neighbouring vertebrae",
                got=f"{upper.name} and {lower.name} closer than that",
                fix="make the voxels smaller, the discs higher or the lordosis less",
            )
