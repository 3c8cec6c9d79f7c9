"""
One's own tissue
================

Stiffness is a matter of two constants. Each label of the mesh may have its own; here one tissue is made twice as stiff
as another, and everything else is left alone.
"""

from dataclasses import replace

import matplotlib.pyplot as plt

from mixpinn.anatomy import tiny_phantom
from mixpinn.dataset import TINY, grid_positions, plan_poses, probe_path
from mixpinn.fem import ContactConfig, Scene, StableNeoHookean, simulate_pose
from mixpinn.geometry.probe_shapes import linear_probe
from mixpinn.stages.mesh import MeshConfig, make_mesh

mesh = make_mesh(tiny_phantom(), MeshConfig(size=4.0)).mesh
probe, protocol = linear_probe(length=40.0), replace(TINY, rotations=(0.0,), max_positions=1)
contact = ContactConfig()
(pose,) = plan_poses(grid_positions(mesh, protocol), protocol, mesh=mesh, probe=probe, gap=contact.gap)
path = probe_path(pose.position, pose.rotation_deg, protocol)

# %%
# Contact is a stiff spring. It is made stiffer together with the tissue here, so that the two problems differ by one
# factor alone.


def pressing_forces(factor):
    """Force that the skin exerts on the probe at each step [N], with all stiffnesses multiplied by `factor`."""
    tissue = StableNeoHookean.from_young(factor * 25.4e-3, 0.45)  # [N/mm²]
    scene = Scene(mesh, probe, (tissue,), contact=replace(contact, stiffness=factor * contact.stiffness))
    return simulate_pose(scene, path, position_index=0, rotation_deg=0.0).probe_wrench[:, 1]


soft, stiff = pressing_forces(1.0), pressing_forces(2.0)
figure, axes = plt.subplots(figsize=(5.0, 3.5), layout="constrained")
axes.plot(path.depths, soft, "o-", label="E = 25.4 kPa")
axes.plot(path.depths, stiff, "o-", label="twice as stiff")
axes.set(xlabel="depth [mm]", ylabel="force [N]")
axes.legend(frameon=False)

# %%
# **Check.** Equilibrium knows no other scale of stress: twice the stiffness, twice the force.

print(f"{soft[-1]:.4f} N and {stiff[-1]:.4f} N")
assert abs(stiff[-1] / soft[-1] - 2.0) < 1e-5
