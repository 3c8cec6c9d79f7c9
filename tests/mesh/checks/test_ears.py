import numpy as np
import pytest

from mixpinn.mesh.cells.orientation import check_cells
from mixpinn.mesh.checks.ears import peel_flat_ears
from mixpinn.records import TissueMesh

# A slab of two layers of cubes; every cube five tetrahedra, so that an ear can be laid onto an inner edge of its top.
N = 4


def slab() -> TissueMesh:
    """N × N cubes of 10 mm in one layer, Kuhn's six tetrahedra each; the top lies at z = 10."""
    points = np.stack(np.meshgrid(*[10.0 * np.arange(n) for n in (N + 1, N + 1, 2)], indexing="ij"), axis=-1)
    points = points.reshape(-1, 3)
    index = np.arange(len(points)).reshape(N + 1, N + 1, 2)
    cells = []
    for i in range(N):
        for j in range(N):
            for order in ((0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)):
                place, nodes = np.array([i, j, 0]), []
                nodes.append(index[tuple(place)])
                for axis in order:
                    place = place + np.eye(3, dtype=int)[axis]
                    nodes.append(index[tuple(place)])
                a, b, c, d = points[nodes]
                cells.append(nodes if np.linalg.det([b - a, c - a, d - a]) > 0 else [nodes[1], nodes[0], *nodes[2:]])
    n = len(points)
    return TissueMesh(
        points, np.array(cells, dtype=np.int32), np.zeros(n, dtype=np.int16), points[:, 2] == 0.0, (),
        np.zeros(len(cells), dtype=np.int16),
    )


def with_ear(rise: float) -> tuple[TissueMesh, list[int]]:
    """The slab with the diagonal of one inner top square sunk by `rise`, and an ear that covers it."""
    mesh = slab()
    index = np.arange(mesh.n_points).reshape(N + 1, N + 1, 2)
    a, b = index[1, 1, 1], index[2, 2, 1]  # the diagonal of Kuhn's division
    c, d = index[2, 1, 1], index[1, 2, 1]
    points = mesh.points.copy()
    points[[c, d], 2] += rise
    ear = [a, b, c, d]
    p = points[ear]
    ear = ear if np.linalg.det(p[1:] - p[0]) > 0 else [b, a, c, d]
    cells = np.concatenate([mesh.cells, [ear]]).astype(np.int32)
    fields = (mesh.part, mesh.fixed, (), np.zeros(len(cells), dtype=np.int16))
    return TissueMesh(points, cells, *fields), ear


def test_a_flat_ear_is_peeled_and_nothing_else():
    mesh, ear = with_ear(1.0)
    check_cells(mesh.points, mesh.cells, what="mesh")
    peeled = peel_flat_ears(mesh)
    assert len(peeled.cells) == len(mesh.cells) - 1
    assert not any(set(cell) == set(ear) for cell in peeled.cells.tolist())
    check_cells(peeled.points, peeled.cells, what="mesh")
    assert set(np.unique(peeled.cells)) == set(range(mesh.n_points))
    assert len(peeled.boundary_faces) == len(mesh.boundary_faces)  # an edge of the skin was flipped
    lost = mesh.cell_volumes.sum() - peeled.cell_volumes.sum()
    assert lost == pytest.approx(10.0 * 10.0 * 1.0 / 3.0)  # a tetrahedron over the square, 1 mm high
    assert peel_flat_ears(peeled) is peeled


def test_a_steep_ear_stays():
    mesh, _ = with_ear(8.0)
    assert peel_flat_ears(mesh) is mesh


def test_an_ear_of_a_rigid_node_stays():
    mesh, ear = with_ear(1.0)
    part = mesh.part.copy()
    part[ear[0]] = 1
    rigid = TissueMesh(mesh.points, mesh.cells, part, mesh.fixed, ("bone",), mesh.tissue)
    assert peel_flat_ears(rigid) is rigid
