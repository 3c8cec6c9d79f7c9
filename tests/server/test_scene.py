"""Surfaces of rigid parts as the page draws them: closed, outward, whether the part is a cavity or meshed."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from mixpinn.records import TissueMesh
from mixpinn.records.tetrahedra import signed_volumes
from mixpinn.server.protocol import decode_surface
from mixpinn.server.scene import _part_surface
from validation.kuhn import grid_points, kuhn_cells


def body_with_a_cube(keep) -> TissueMesh:
    """A block of 4 × 4 × 4 cubes of 10 mm whose middle 2 × 2 × 2 are rigid; of their cells those of `keep` are left."""
    n, ticks = 5, 10.0 * np.arange(5)
    points, cells = grid_points(ticks, ticks, ticks), kuhn_cells((4, 4, 4))
    part = np.zeros((n, n, n), np.int16)
    part[1:4, 1:4, 1:4] = 1
    part = part.ravel()
    inside = np.flatnonzero((part[cells] == 1).all(axis=1))
    cells = np.delete(cells, np.setdiff1d(inside, inside[keep(points[cells[inside]])]), axis=0)
    used = np.unique(cells)
    return TissueMesh(
        points[used], np.searchsorted(used, cells).astype(np.int32), part[used], points[used, 1] == 0.0, ("cube",),
        np.zeros(len(cells), np.int16),
    )


def one_beside_the_middle(corners):
    """The first cell that does not touch the cube's middle: all its nodes lie on the cavity."""
    touches = (np.abs(corners - 20.0).max(axis=2) < 1.0).any(axis=1)
    return np.arange(len(corners)) == np.flatnonzero(~touches)[0]


@pytest.mark.parametrize(("keep", "left"), [
    (lambda corners: np.zeros(len(corners), bool), 0),
    (one_beside_the_middle, 1),
    (lambda corners: np.ones(len(corners), bool), 0),
], ids=["cavity", "cavity with a cell in it", "meshed"])
def test_a_part_has_a_closed_outward_surface(keep, left) -> None:
    mesh = body_with_a_cube(keep)
    points, triangles, _ = decode_surface(_part_surface(mesh, 1))
    corners = points[triangles].astype(float)
    volume = np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0
    cell = signed_volumes(mesh.points, mesh.cells)[0]
    assert_allclose(volume, 8000.0 - left * cell)
    ways = np.concatenate([triangles[:, pair] for pair in ([0, 1], [1, 2], [2, 0])])
    assert sorted(map(tuple, ways)) == sorted(map(tuple, ways[:, ::-1]))  # each edge as often in either direction
