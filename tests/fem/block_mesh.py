"""Blocks of tetrahedra for the tests of the finite elements."""

import numpy as np

from mixpinn.records import TissueMesh
from validation import blocks
from validation.blocks import labelled


def block(counts: tuple[int, int, int], *, size: tuple[float, float, float] = (1.0, 1.0, 1.0), shake: float = 0.0,
          seed: int = 0) -> TissueMesh:
    """A box of `counts` cubes, six tetrahedra each, interior nodes displaced by up to `shake` of a cube."""
    return blocks.block(counts, size=size, shake=shake, rng=np.random.default_rng(seed), mirrored=False)


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
