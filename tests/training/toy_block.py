"""A toy problem: a structured block of tetrahedra with two rigid parts, and smooth fields pressed into its top."""

import numpy as np

from mixpinn.networks import ModelConfig
from mixpinn.records import SampleTable, TissueMesh
from validation.kuhn import grid_points, kuhn_cells

TINY = ModelConfig(layers=2, heads=2, hidden=8, virtual_nodes=True)


def block_mesh(shift: float = 0.0) -> TissueMesh:
    """5 × 5 × 5 nodes 10 mm apart, six tetrahedra a cube; two columns of four nodes are rigid, y = 0 is fixed."""
    n = 5
    index = np.arange(n**3).reshape(n, n, n)
    ticks = 10.0 * np.arange(n)
    points = grid_points(ticks + shift, ticks, ticks)
    cells = kuhn_cells((n - 1, n - 1, n - 1))
    part = np.zeros(n**3, dtype=np.int16)
    part[index[1:3, 2, 1:3].ravel()] = 1
    part[index[1:3, 2, 3:5].ravel()] = 2
    return TissueMesh(
        points, cells, part, points[:, 1] == 0.0, ("L1", "L2"),
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
