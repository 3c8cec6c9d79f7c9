"""
Where the work goes
===================

Without friction the work that the probe does is stored as elastic energy, all of it: ∫ F dx = E. Every step of a
simulation records both sides.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import mixpinn as mx
from mixpinn.anatomy import tiny_phantom
from mixpinn.dataset import TINY, grid_positions, plan_poses, probe_path
from mixpinn.fem import simulate_pose

mesh = mx.make_mesh(tiny_phantom(), size=4.0)
scene = mx.Scene(mesh, mx.linear_probe(length=40.0), contact=mx.ContactConfig(friction=0.0))
protocol = replace(TINY, rotations=(0.0,), max_positions=1, step=0.5, steps=12)
positions = grid_positions(mesh, protocol)
(pose,) = plan_poses(positions, protocol, mesh=mesh, probe=scene.probe, gap=scene.contact.gap)
path = probe_path(pose.position, pose.rotation_deg, protocol)
answer = simulate_pose(scene, path, position_index=0, rotation_deg=0.0)

# %%
# The force against the way, integrated by the trapezoidal rule, beside the energy of the solver.

force = np.concatenate([[0.0], answer.probe_wrench[:, 1]])  # the first step begins at first touch
way = np.concatenate([[0.0], path.depths])
work = np.concatenate([[0.0], np.cumsum(0.5 * (force[1:] + force[:-1]) * np.diff(way))])
figure, axes = plt.subplots(figsize=(6.0, 3.5), layout="constrained")
axes.plot(way, work, "o", label="work of the probe")
axes.plot(way[1:], answer.energy, "-", label="elastic energy")
axes.set(xlabel="depth [mm]", ylabel="[N mm]")
axes.legend(frameon=False)

# %%
# **Check.** They agree to the accuracy of the trapezoidal rule, and to what the penalty of the contact stores.

print(f"work {work[-1]:.2f} N mm, energy {answer.energy[-1]:.2f} N mm")
assert abs(work[-1] / answer.energy[-1] - 1.0) < 0.01
