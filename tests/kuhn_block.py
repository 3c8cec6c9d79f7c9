"""Kuhn's subdivision of a regular grid: the cells of every structured block in the tests."""

import itertools

import numpy as np

from mixpinn.base.arrays import FloatArray, Int32Array


def kuhn_cells(counts: tuple[int, int, int]) -> Int32Array:
    """Six positively oriented tetrahedra for each of `counts` cubes, cube by cube; nodes numbered as `grid_points`.

    Each walks from one corner of the cube to the opposite one, one axis at a time.
    """
    shape = np.array(counts) + 1
    corner = np.stack(np.meshgrid(*[np.arange(count) for count in counts], indexing="ij"), axis=-1).reshape(-1, 3)
    cells = np.empty((len(corner), 6, 4), dtype=np.int32)
    for number, order in enumerate(itertools.permutations(range(3))):
        steps = np.concatenate([np.zeros((1, 3), dtype=int), np.cumsum(np.eye(3, dtype=int)[list(order)], axis=0)])
        nodes = [np.ravel_multi_index(tuple((corner + step).T), tuple(shape)) for step in steps]
        if np.linalg.det(steps[1:] - steps[0]) < 0:
            nodes[0], nodes[1] = nodes[1], nodes[0]
        cells[:, number] = np.stack(nodes, axis=1)
    return cells.reshape(-1, 4)


def grid_points(*axes: FloatArray) -> FloatArray:
    """Nodes of the grid on three axes [mm], the last axis running fastest, shape (n, 3)."""
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3).astype(float)
