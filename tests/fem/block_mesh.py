"""Blocks of tetrahedra for the tests of the finite elements."""

import numpy as np

from kuhn_block import grid_points, kuhn_cells
from mixpinn.base.arrays import FloatArray
from mixpinn.records import TissueMesh


def block(counts: tuple[int, int, int], *, size: tuple[float, float, float] = (1.0, 1.0, 1.0), shake: float = 0.0,
          seed: int = 0) -> TissueMesh:
    """A box of `counts` cubes, six tetrahedra each (Kuhn), interior nodes displaced by up to `shake` of a cube."""
    points = grid_points(*[np.linspace(0.0, length, count + 1) for length, count in zip(size, counts, strict=True)])
    inside = ((points > 1e-9) & (points < np.array(size) - 1e-9)).all(axis=1)
    spacing = np.array(size) / np.array(counts)
    points[inside] += shake * spacing * np.random.default_rng(seed).uniform(-1.0, 1.0, (int(inside.sum()), 3))
    return labelled(points, kuhn_cells(counts))


def labelled(points: FloatArray, cells: np.ndarray, *, part: np.ndarray | None = None, fixed: np.ndarray | None = None,
             tissue: np.ndarray | None = None) -> TissueMesh:
    """A mesh with the given labels, by default one free soft tissue."""
    part = np.zeros(len(points), dtype=np.int16) if part is None else part.astype(np.int16)
    fixed = np.zeros(len(points), dtype=bool) if fixed is None else fixed
    tissue = np.zeros(len(cells), dtype=np.int16) if tissue is None else tissue.astype(np.int16)
    return TissueMesh(
        points, cells.astype(np.int32), part, fixed, tuple(f"bone{k + 1}" for k in range(int(part.max(initial=0)))),
        tissue, tuple(f"tissue{k}" for k in range(int(tissue.max(initial=0)) + 1)),
    )


def two_bones(counts: tuple[int, int, int] = (6, 3, 3)) -> TissueMesh:
    """A shaken block of 60 × 30 × 30 mm, fixed below, with two boxes of nodes inside that are rigid."""
    mesh = block(counts, size=(60.0, 30.0, 30.0), shake=0.2)
    x, y, z = mesh.points.T
    central = (np.abs(y - 15.0) < 10.0) & (np.abs(z - 17.0) < 12.0)
    part = np.where(central & (x > 5) & (x < 25), 1, 0) + np.where(central & (x > 35) & (x < 55), 2, 0)
    return labelled(mesh.points, mesh.cells, part=part, fixed=(z < 1e-9) & (part == 0))


def carved(mesh: TissueMesh) -> TissueMesh:
    """The mesh without the cells inside rigid parts, which become cavities as in the meshes of patients."""
    group = mesh.part[mesh.cells]
    soft = (group == 0).any(axis=1) | (group != group[:, :1]).any(axis=1)
    used = np.unique(mesh.cells[soft])
    index = np.full(mesh.n_points, -1)
    index[used] = np.arange(len(used))
    return labelled(
        mesh.points[used], index[mesh.cells[soft]], part=mesh.part[used], fixed=mesh.fixed[used],
        tissue=mesh.tissue[soft],
    )
