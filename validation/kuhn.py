"""Kuhn's subdivision of a grid: the cells of every structured block in checks, benchmarks and tests."""

import itertools

import numpy as np

from mixpinn.base.arrays import FloatArray, Int32Array


def kuhn_cells(counts: tuple[int, int, int], *, mirrored: bool = False) -> Int32Array:
    """Six positively oriented tetrahedra for each of `counts` cubes, cube by cube; nodes numbered as `grid_points`.

    Each walks from one corner of the cube to the opposite one, one axis at a time.

    Args:
        counts: cubes along each axis.
        mirrored: mirror each cube's subdivision in its neighbour, so that the diagonals alternate and no direction is
            preferred.
    """
    shape = tuple(np.array(counts) + 1)
    corner = np.stack(np.meshgrid(*[np.arange(count) for count in counts], indexing="ij"), axis=-1).reshape(-1, 3)
    flip = corner % 2 if mirrored else np.zeros_like(corner)
    odd = flip.sum(axis=1) % 2 == 1
    cells = np.empty((len(corner), 6, 4), dtype=np.int32)
    for number, order in enumerate(itertools.permutations(range(3))):
        steps = np.concatenate([np.zeros((1, 3), dtype=int), np.cumsum(np.eye(3, dtype=int)[list(order)], axis=0)])
        cells[:, number] = np.stack(
            [np.ravel_multi_index(tuple((corner + (step ^ flip)).T), shape) for step in steps], axis=1,
        )
        turned = odd != (np.linalg.det(steps[1:] - steps[0]) < 0)
        cells[turned, number, :2] = cells[turned, number, 1::-1]
    return cells.reshape(-1, 4)


def grid_points(*axes: FloatArray) -> FloatArray:
    """Nodes of the grid on three axes [mm], the last axis running fastest, shape (n, 3)."""
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3).astype(float)
