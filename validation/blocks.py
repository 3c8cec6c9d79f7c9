"""Blocks of tetrahedra: the meshes of the analytic checks."""

import numpy as np

from mixpinn.base.arrays import AnyArray, BoolArray, FloatArray
from mixpinn.records import TissueMesh
from validation.kuhn import grid_points, kuhn_cells


def labelled(
    points: FloatArray, cells: AnyArray, *, part: AnyArray | None = None, fixed: BoolArray | None = None,
    tissue: AnyArray | None = None,
) -> TissueMesh:
    """A mesh with the given labels; by default nothing is rigid or fixed, and there is one tissue."""
    part = np.zeros(len(points), dtype=np.int16) if part is None else part.astype(np.int16)
    fixed = np.zeros(len(points), dtype=bool) if fixed is None else fixed
    tissue = np.zeros(len(cells), dtype=np.int16) if tissue is None else tissue.astype(np.int16)
    return TissueMesh(
        points, cells.astype(np.int32), part, fixed, tuple(f"bone{k + 1}" for k in range(int(part.max(initial=0)))),
        tissue, tuple(f"tissue {k}" for k in range(int(tissue.max(initial=0)) + 1)),
    )


def grid_block(x: FloatArray, y: FloatArray, z: FloatArray) -> TissueMesh:
    """A block on the tensor product of ascending coordinates [mm], six tetrahedra a cell, neighbours mirrored."""
    return labelled(grid_points(x, y, z), kuhn_cells((len(x) - 1, len(y) - 1, len(z) - 1), mirrored=True))


def block(
    counts: tuple[int, int, int], *, size: tuple[float, float, float] = (1.0, 1.0, 1.0), shake: float = 0.0,
    rng: np.random.Generator | None = None, mirrored: bool = True,
) -> TissueMesh:
    """A regular block; its inner nodes are shaken by up to `shake` of the spacing where an `rng` is given."""
    points = grid_points(*(np.linspace(0.0, length, n + 1) for length, n in zip(size, counts, strict=True)))
    mesh = labelled(points, kuhn_cells(counts, mirrored=mirrored))
    if rng is None:
        return mesh
    inside = ~surface_nodes(mesh)
    points = points.copy()
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
