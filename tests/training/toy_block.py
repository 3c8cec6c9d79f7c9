"""A toy problem: a structured block of tetrahedra with two rigid parts, and smooth fields pressed into its top."""

import itertools

import numpy as np

from mixpinn.networks import ModelConfig
from mixpinn.records import SampleTable, TissueMesh

TINY = ModelConfig(layers=2, heads=2, hidden=8, virtual_nodes=True)


def block_mesh(shift: float = 0.0) -> TissueMesh:
    """5 × 5 × 5 nodes 10 mm apart, six tetrahedra a cube; two columns of four nodes are rigid, y = 0 is fixed."""
    n = 5
    index = np.arange(n**3).reshape(n, n, n)
    grid = np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), axis=-1)
    points = 10.0 * grid.reshape(-1, 3) + [shift, 0.0, 0.0]
    cells = []
    for corner in itertools.product(range(n - 1), repeat=3):
        for order in itertools.permutations(range(3)):
            # Kuhn's subdivision: walk from one corner of the cube to the opposite one, one axis at a time.
            path = [np.array(corner)]
            for axis in order:
                path.append(path[-1] + np.eye(3, dtype=int)[axis])
            cell = [int(index[tuple(node)]) for node in path]
            a, b, c, d = points[cell]
            cells.append(cell if np.linalg.det([b - a, c - a, d - a]) > 0 else [cell[1], cell[0], *cell[2:]])
    part = np.zeros(n**3, dtype=np.int16)
    part[index[1:3, 2, 1:3].ravel()] = 1
    part[index[1:3, 2, 3:5].ravel()] = 2
    return TissueMesh(
        points, np.array(cells, dtype=np.int32), part, points[:, 1] == 0.0, ("L1", "L2"),
        np.zeros(len(cells), dtype=np.int16),
    )


def block_table(mesh: TissueMesh, n_samples: int, *, seed: int = 0) -> SampleTable:
    """Samples that press a random patch of the top down; the field decays towards the fixed bottom."""
    rng = np.random.default_rng(seed)
    top = np.flatnonzero(mesh.points[:, 1] == mesh.points[:, 1].max())
    fields, nodes, offsets = [], [], [0]
    for _ in range(n_samples):
        centre, depth = rng.uniform(10.0, 30.0, 2), rng.uniform(0.5, 4.0)
        distance = np.linalg.norm(mesh.points[:, [0, 2]] - centre, axis=1)
        field = np.zeros_like(mesh.points)
        field[:, 1] = -depth * np.exp(-((distance / 15.0) ** 2)) * mesh.points[:, 1] / 40.0
        contacts = top[distance[top] < 12.0]
        fields.append(field)
        nodes.append(contacts)
        offsets.append(offsets[-1] + len(contacts))
    count = np.arange(n_samples)
    return SampleTable(
        mesh.hash(), count, np.zeros(n_samples), np.ones(n_samples), np.zeros((n_samples, 3)),
        np.tile(np.eye(3), (n_samples, 1, 1)), np.array(offsets), np.concatenate(nodes),
        np.ones((offsets[-1], 3)), np.zeros((n_samples, 6)), np.array(fields, dtype=np.float32),
    )
