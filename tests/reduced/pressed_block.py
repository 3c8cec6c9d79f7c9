"""Equilibria of the toy block under imposed displacements of its top, solved by finite elements."""

import numpy as np

from mixpinn.fem import ElasticSystem, SolverConfig, StableNeoHookean, SuperLUSolver, solve_imposed
from mixpinn.physics.restraints import FREE, Restraints
from mixpinn.records import SampleTable, TissueMesh

TISSUE = StableNeoHookean.from_young(25.4e-3, 0.45)


def top_nodes(mesh: TissueMesh):
    free = (mesh.node_part == 0) & ~mesh.node_fixed
    return np.flatnonzero(free & (mesh.node_points[:, 1] == mesh.node_points[free, 1].max()))


def pressed_table(
    mesh: TissueMesh, n_samples: int, *, seed: int = 0, restraints: Restraints = FREE, materials=(TISSUE,),
) -> SampleTable:
    """Samples at `n_samples` positions: a patch of the top pressed in by up to 4 mm with some shear."""
    rng = np.random.default_rng(seed)
    top = top_nodes(mesh)
    system = ElasticSystem(
        mesh, materials, joints=restraints.joints, foundations=restraints.foundations, membrane=restraints.membrane,
    )
    fields, nodes, offsets, depths = [], [], [0], []
    for _ in range(n_samples):
        centre, depth = rng.uniform(10.0, 30.0, 2), rng.uniform(0.5, 4.0)
        chosen = top[np.linalg.norm(mesh.node_points[top][:, [0, 2]] - centre, axis=1) < 12.0]
        move = np.tile([rng.uniform(-0.3, 0.3) * depth, -depth, 0.1 * depth], (len(chosen), 1))
        found = solve_imposed(system, [(chosen, move)], config=SolverConfig(tolerance=1e-9), linear=SuperLUSolver())
        assert found.converged.all()
        fields.append(found.displacement[0])
        nodes.append(chosen)
        offsets.append(offsets[-1] + len(chosen))
        depths.append(depth)
    count = np.arange(n_samples)
    return SampleTable(
        mesh.hash(), count, np.zeros(n_samples), np.array(depths), np.zeros((n_samples, 3)),
        np.tile(np.eye(3), (n_samples, 1, 1)), np.array(offsets), np.concatenate(nodes), np.ones((offsets[-1], 3)),
        np.zeros((n_samples, 6)), np.array(fields, dtype=np.float32),
    )
