"""
Pressure under the probe
========================

A simulation keeps the force on every node of the skin that the probe touches. Pressure follows from it and
the deformed skin around the node.
"""

from dataclasses import replace

import numpy as np
import pyvista as pv

import mixpinn as mx
from mixpinn.anatomy import tiny_phantom
from mixpinn.dataset import TINY, grid_positions, plan_poses, probe_path
from mixpinn.fem import contact_pressure, simulate_pose

mesh = mx.make_mesh(tiny_phantom(), size=3.0)
scene = mx.Scene(mesh, mx.spherical_probe(radius=25.0, subdivisions=3))
protocol = replace(TINY, rotations=(0.0,), max_positions=1, steps=4)
positions = grid_positions(mesh, protocol)
(pose,) = plan_poses(positions, protocol, mesh=mesh, probe=scene.probe, gap=scene.contact.gap)
path = probe_path(pose.position, pose.rotation_deg, protocol)
answer = simulate_pose(scene, path, position_index=0, rotation_deg=0.0)

# %%
# The pressure in kPa on the nodes that carry load.

last = len(path) - 1
found = contact_pressure(mesh, answer, last)
skin = pv.PolyData.from_regular_faces(mesh.points + answer.displacement[last], mesh.skin_faces)
skin["pressure [kPa]"] = np.zeros(mesh.n_points)
skin["pressure [kPa]"][found.nodes] = 1e3 * found.pressure
plotter = pv.Plotter(window_size=(800, 500))
plotter.add_mesh(skin, scalars="pressure [kPa]", cmap="Reds", show_edges=True,
                 scalar_bar_args={"vertical": True})
plotter.view_vector((0.3, 1.0, -0.3), viewup=(0.0, 0.0, -1.0))
plotter.show()

# %%
# **Check.** Pressure times area is the force on the probe: the nodes' pressures know the skin's areas and the nodes'
# forces, the recorded wrench neither.

pressed = float((found.pressure * found.area).sum())
print(f"{pressed:.3f} N over {len(found.nodes)} nodes, {answer.probe_wrench[last, 1]:.3f} N on the probe")
assert abs(pressed - answer.probe_wrench[last, 1]) < 1e-9 * pressed
