"""Blocks of tetrahedra: the meshes of the analytic checks."""

import numpy as np

from mixpinn.base.arrays import BoolArray, FloatArray, IntArray
from mixpinn.records import TissueMesh

# The six tetrahedra around the main diagonal of a cell whose corner number is i + 2 j + 4 k.
_KUHN = np.array([[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7], [0, 5, 1, 7]])


def labelled(
    points: FloatArray, cells: IntArray, *, part: IntArray | None = None, fixed: BoolArray | None = None,
) -> TissueMesh:
    """A mesh of one tissue with the given labels; by default nothing is rigid or fixed."""
    part = np.zeros(len(points), dtype=np.int16) if part is None else part.astype(np.int16)
    fixed = np.zeros(len(points), dtype=bool) if fixed is None else fixed
    names = tuple(f"bone {k + 1}" for k in range(int(part.max(initial=0))))
    return TissueMesh(points, cells.astype(np.int32), part, fixed, names, np.zeros(len(cells), dtype=np.int16))


def grid_block(x: FloatArray, y: FloatArray, z: FloatArray) -> TissueMesh:
    """A block on the tensor product of ascending coordinates [mm], six tetrahedra a cell, mirrored from cell to cell.

    The diagonals alternate, so that no direction is preferred.
    """
    points = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1).reshape(-1, 3)
    index = np.arange(len(points)).reshape(len(x), len(y), len(z))
    cells = []
    for i0 in (0, 1):
        for j0 in (0, 1):
            for k0 in (0, 1):
                i, j, k = np.meshgrid(
                    np.arange(i0, len(x) - 1, 2), np.arange(j0, len(y) - 1, 2), np.arange(k0, len(z) - 1, 2),
                    indexing="ij",
                )
                corners = np.stack([
                    index[i + (n % 2 ^ i0), j + (n // 2 % 2 ^ j0), k + (n // 4 ^ k0)].ravel() for n in range(8)
                ], axis=1)
                block = corners[:, _KUHN].reshape(-1, 4)
                cells.append(block[:, [0, 2, 1, 3]] if (i0 + j0 + k0) % 2 else block)
    return labelled(points, np.concatenate(cells))


def block(counts: tuple[int, int, int], *, size: tuple[float, float, float] = (1.0, 1.0, 1.0), shake: float = 0.0,
          rng: np.random.Generator | None = None) -> TissueMesh:
    """A regular block; its inner nodes are shaken by up to `shake` of the spacing where an `rng` is given."""
    mesh = grid_block(*(np.linspace(0.0, length, n + 1) for length, n in zip(size, counts, strict=True)))
    if rng is None:
        return mesh
    inside = ~surface_nodes(mesh)
    points = mesh.points.copy()
    spacing = np.array(size) / np.array(counts)
    points[inside] += shake * spacing * rng.uniform(-1.0, 1.0, (int(inside.sum()), 3))
    return labelled(points, mesh.cells)


def surface_nodes(mesh: TissueMesh) -> BoolArray:
    """Nodes on the faces of the bounding box, shape (n,)."""
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    return ((mesh.points < low + 1e-9) | (mesh.points > high - 1e-9)).any(axis=1)


def two_bones() -> TissueMesh:
    """A shaken block of 60 × 30 × 30 mm, fixed at its lower face (y = 0), with two rigid boxes inside."""
    mesh = block((12, 6, 6), size=(60.0, 30.0, 30.0), shake=0.15, rng=np.random.default_rng(0))
    x, y, z = mesh.points.T
    central = (np.abs(z - 15.0) < 9.0) & (np.abs(y - 12.0) < 6.5)
    part = np.where(central & (x > 8) & (x < 25), 1, 0) + np.where(central & (x > 35) & (x < 52), 2, 0)
    return labelled(mesh.points, mesh.cells, part=part, fixed=(y < 1e-9) & (part == 0))
