"""Orientation of tetrahedra, and whether cells fit together without folds."""

import numpy as np

from mixpinn.base.arrays import AnyArray, FloatArray, Int32Array
from mixpinn.base.errors import InputError
from mixpinn.records.tetrahedra import TETRA_FACES, signed_volumes

ZERO_VOLUME = 1e-9
"""A cell counts as flat where its volume is below this fraction of its longest edge cubed."""


def orient_cells(points: FloatArray, cells: AnyArray) -> Int32Array:
    """Cells with positive volume, int32, shape (m, 4): the first two nodes of negative ones are exchanged."""
    oriented = np.array(cells, dtype=np.int32)
    negative = signed_volumes(points, oriented) < 0.0
    oriented[negative] = oriented[negative][:, [1, 0, 2, 3]]
    return oriented


def flat_cells(points: FloatArray, cells: AnyArray) -> AnyArray:
    """Indices of cells without volume."""
    corners = points[cells]
    longest = np.linalg.norm(corners[:, :, None] - corners[:, None, :], axis=-1).max(axis=(1, 2))
    return np.flatnonzero(np.abs(signed_volumes(points, cells)) <= ZERO_VOLUME * longest**3)


def check_cells(points: FloatArray, cells: AnyArray, *, what: str) -> None:
    """Refuse cells that are flat, inverted or folded over a neighbour, and faces of more than two cells.

    A face between two positively oriented cells is run through in opposite directions by the two; where both run
    the same way the cells lie on one side of it: one of them is inverted.

    Args:
        points: [mm], shape (n, 3).
        cells: shape (m, 4).
        what: the mesh, as the user names it.

    Raises:
        InputError: naming the number of faulty cells and the first of them.
    """
    flat = flat_cells(points, cells)
    if len(flat):
        raise InputError(
            what, expected="tetrahedra with a volume", got=f"{len(flat)} of zero volume (the first is cell {flat[0]})",
            fix="mesh the anatomy again or remove these cells",
        )
    if (inverted := np.flatnonzero(signed_volumes(points, cells) < 0.0)).size:
        raise InputError(
            what, expected="positively oriented tetrahedra",
            got=f"{len(inverted)} inverted (the first is cell {inverted[0]})", fix="exchange two nodes of these cells",
        )
    faces = np.asarray(cells, dtype=np.int64)[:, TETRA_FACES].reshape(-1, 3)
    order = np.argsort(faces, axis=1)
    # An even permutation to ascending order keeps the direction of a triangle, an odd one reverses it.
    odd = (order == [0, 2, 1]).all(1) | (order == [1, 0, 2]).all(1) | (order == [2, 1, 0]).all(1)
    _, face, count = np.unique(np.sort(faces, axis=1), axis=0, return_inverse=True, return_counts=True)
    if (crowded := np.flatnonzero(count > 2)).size:
        first = int(np.flatnonzero(face == crowded[0])[0]) // 4
        raise InputError(
            what, expected="faces shared by at most two cells",
            got=f"{len(crowded)} shared by more (near cell {first})", fix="remove duplicate cells",
        )
    direction = np.bincount(face, weights=np.where(odd, -1.0, 1.0))
    if (folded := np.flatnonzero((count == 2) & (direction != 0.0))).size:
        first = int(np.flatnonzero(face == folded[0])[0]) // 4
        raise InputError(
            what, expected="cells that do not overlap", got=f"{len(folded)} faces with both cells on one side, so that "
            f"a cell is inverted (near cell {first})", fix="mesh the anatomy again or remove the inverted cells",
        )
