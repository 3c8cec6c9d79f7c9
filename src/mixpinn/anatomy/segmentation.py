"""Segmentation: the structures of one image as they came, each with a mask of its own, before they become labels."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mixpinn.anatomy.finding import Finding
from mixpinn.base.arrays import BoolArray, FloatArray

Index3 = tuple[int, int, int]


@dataclass(frozen=True, eq=False)
class Structure:
    """Voxels of one structure, cut to their bounding box so that small parts of large images stay small.

    Attributes:
        name: as the user names it.
        mask: its voxels within the box, shape (bi, bj, bk); empty where the structure has no voxel.
        corner: image index of the box's first voxel.
    """

    name: str
    mask: BoolArray
    corner: Index3 = (0, 0, 0)

    @staticmethod
    def trim(name: str, mask: BoolArray, corner: Index3 = (0, 0, 0)) -> "Structure":
        """Cut `mask`, whose first voxel is image index `corner`, to its bounding box."""
        kept = []
        for axis in range(3):
            others = tuple(other for other in range(3) if other != axis)
            used = np.flatnonzero(mask.any(axis=others))
            if not len(used):
                return Structure(name, np.zeros((0, 0, 0), dtype=bool), corner)
            kept.append(slice(int(used[0]), int(used[-1]) + 1))
        first, second, third = (corner[axis] + kept[axis].start for axis in range(3))
        return Structure(name, np.ascontiguousarray(mask[tuple(kept)]), (first, second, third))

    @cached_property
    def n_voxels(self) -> int:
        """Number of voxels."""
        return int(np.count_nonzero(self.mask))

    @property
    def stop(self) -> Index3:
        """Image index just behind the box's last voxel."""
        first, second, third = (c + n for c, n in zip(self.corner, self.mask.shape, strict=True))
        return first, second, third

    @property
    def box(self) -> tuple[Index3, Index3]:
        """First image index of the box and the one just behind its last."""
        return self.corner, self.stop

    @cached_property
    def centroid(self) -> FloatArray:
        """Mean voxel index in the image, shape (3,)."""
        return np.argwhere(self.mask).mean(axis=0) + np.array(self.corner)

    def window(self, start: Index3, stop: Index3) -> BoolArray:
        """The mask on image indices start … stop, False where that reaches beyond the box."""
        window = np.zeros([max(0, b - a) for a, b in zip(start, stop, strict=True)], dtype=bool)
        first = [max(a, c) for a, c in zip(start, self.corner, strict=True)]
        last = [min(b, s) for b, s in zip(stop, self.stop, strict=True)]
        if all(b > a for a, b in zip(first, last, strict=True)):
            target = tuple(slice(f - a, e - a) for f, e, a in zip(first, last, start, strict=True))
            source = tuple(slice(f - c, e - c) for f, e, c in zip(first, last, self.corner, strict=True))
            window[target] = self.mask[source]
        return window

    def with_window(self, window: BoolArray, start: Index3) -> "Structure":
        """The structure with the voxels from image index `start` on replaced by `window`, the rest kept."""
        stop = tuple(a + n for a, n in zip(start, window.shape, strict=True))
        low = _index3(min(a, c) for a, c in zip(start, self.corner, strict=True))
        high = _index3(max(b, s) for b, s in zip(stop, self.stop, strict=True))
        mask = self.window(low, high)
        mask[tuple(slice(a - o, b - o) for a, b, o in zip(start, stop, low, strict=True))] = window
        return Structure.trim(self.name, mask, low)


@dataclass(frozen=True, eq=False)
class Segmentation:
    """Body, soft tissues and rigid parts on one image grid; parts may still overlap, touch or stick out.

    Attributes:
        body: everything inside the skin.
        soft: further soft tissues inside the body.
        rigid: rigid parts, in the order they were asked for.
        affine: voxel index to the scanner's RAS frame [mm], shape (4, 4).
        shape: of the image grid.
        notes: what was noticed while reading, and which bone plays which part.
        targets: rigid parts that the crop follows; empty where all of them are.
        cut: rigid parts of which some lies outside the crop or the image.
    """

    body: Structure
    soft: tuple[Structure, ...]
    rigid: tuple[Structure, ...]
    affine: FloatArray
    shape: Index3
    notes: tuple[Finding, ...] = ()
    targets: tuple[str, ...] = ()
    cut: tuple[str, ...] = ()

    @property
    def parts(self) -> tuple[Structure, ...]:
        """Soft tissues and rigid parts, without the body."""
        return self.soft + self.rigid

    @property
    def spacing(self) -> FloatArray:
        """Voxel size along each grid axis [mm], shape (3,)."""
        return np.linalg.norm(self.affine[:3, :3], axis=0)

    def heights(self, structure: Structure) -> FloatArray:
        """Height (S of RAS) of the voxel centres of the structure's box [mm], broadcastable to its mask.

        Grid axes that do not contribute keep length 1, so that images along the body's axis cost next to nothing.
        """
        height = np.full((1, 1, 1), self.affine[2, 3])
        for axis in range(3):
            if self.affine[2, axis] != 0.0:
                index = structure.corner[axis] + np.arange(structure.mask.shape[axis])
                height = height + (self.affine[2, axis] * index).reshape([-1 if a == axis else 1 for a in range(3)])
        return height

    def with_part(self, part: Structure) -> "Segmentation":
        """The segmentation with the body, tissue or part of that name replaced."""
        if part.name == self.body.name:
            return replace(self, body=part)
        return replace(
            self,
            soft=tuple(part if old.name == part.name else old for old in self.soft),
            rigid=tuple(part if old.name == part.name else old for old in self.rigid),
        )


def grown_box(structure: Structure, by: int) -> tuple[Index3, Index3]:
    """The structure's box grown by `by` voxels on every side; it may reach beyond the image."""
    return _index3(c - by for c in structure.corner), _index3(s + by for s in structure.stop)


def common_box(first: Structure, second: Structure) -> tuple[Index3, Index3]:
    """The smallest box around two structures."""
    return (
        _index3(min(a, b) for a, b in zip(first.corner, second.corner, strict=True)),
        _index3(max(a, b) for a, b in zip(first.stop, second.stop, strict=True)),
    )


def _index3(values: Iterable[int]) -> Index3:
    first, second, third = (int(value) for value in values)
    return first, second, third
