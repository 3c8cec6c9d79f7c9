"""A press with a joint between two bones: the full solve converges, and the joint does what it is there for."""

from dataclasses import replace

import numpy as np

from fem.block_mesh import labelled, two_bones
from mixpinn.fem import Joint, JointFrame, LinearBushing, Scene, StableNeoHookean, simulate_pose
from mixpinn.geometry.probe_shapes import spherical_probe
from mixpinn.geometry.rotations import vector_from_rotation
from mixpinn.records import ProbePath, Simulation

FRAME = JointFrame("bone1", "bone2", (30.0, 15.0, 15.0), ((1, 0, 0), (0, 1, 0), (0, 0, 1)))
BLOCK = two_bones((6, 3, 3))
BLOCK = labelled(BLOCK.points, BLOCK.cells, part=BLOCK.part, fixed=BLOCK.points[:, 1] < 1e-9)
SCENE = Scene(BLOCK, spherical_probe(radius=8.0, subdivisions=3), (StableNeoHookean(mu=0.02, lam=0.1),))


def pressed(joints: tuple[Joint, ...]) -> Simulation:
    """Pressed along −y over the left bone, up to 4 mm."""
    tips = np.array([[17.0, 32.0 - depth, 15.0] for depth in (-3.0, 1.0, 2.5, 4.0)])
    path = ProbePath(tips, np.tile(np.eye(3), (4, 1, 1)), np.arange(4) * 1.0)
    return simulate_pose(replace(SCENE, joints=joints), path, position_index=0, rotation_deg=0.0)


def test_the_stiffer_the_joint_the_less_the_bones_move_against_each_other() -> None:
    found = [
        pressed(joints) for joints in (
            (), (Joint(FRAME, LinearBushing.of_diagonal([0.0] * 6)),),
            (Joint(FRAME, LinearBushing.of_diagonal([0.3] * 3 + [100.0] * 3)),),
            (Joint(FRAME, LinearBushing.of_diagonal([1e3] * 3 + [1e6] * 3)),),
        )
    ]
    assert all(simulation.converged.all() for simulation in found)
    np.testing.assert_array_equal(found[0].displacement, found[1].displacement)
    turns = [vector_from_rotation(simulation.part_rotation[-1]) for simulation in found]
    against = [float(np.linalg.norm(one - two)) for one, two in turns[1:]]
    assert against[0] > 1.2 * against[1] > 1.2 * against[2]
    assert against[2] <= 1e-4  # stiff: they turn as one
    forces = [float(simulation.probe_wrench[-1, 1]) for simulation in found[1:]]
    assert forces[0] < forces[1] < forces[2]
    for simulation in found:  # tissue, probe and joint leave nothing unbalanced on a bone
        assert simulation.part_wrench is not None
        assert np.abs(simulation.part_wrench[-1, :, :3]).max() <= 1e-5 * simulation.probe_wrench[-1, 1]
