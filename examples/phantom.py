"""
The phantom in twenty lines
===========================

A label map is meshed, and a probe presses on the back. Nothing is needed but the package: the anatomy is the built-in
phantom.
"""
# sphinx_gallery_thumbnail_number = 1

import numpy as np
import pyvista as pv

import mixpinn as mx
from mixpinn.anatomy import tiny_phantom

mesh = mx.make_mesh(tiny_phantom(), size=4.0)
scene = mx.Scene(mesh, mx.linear_probe(length=40.0))  # default tissue
back = mesh.points[:, 1].max()  # world frame [mm]: x to the right, y to the back, z down the body
answer = mx.solve_pose(scene, tip=(0.0, back - 4.0, 0.0))
print(f"{mesh.n_points} nodes; the skin pushes back with {answer.force[1]:.2f} N")
for name, motion in answer.motions.items():
    print(f"{name} moves by {motion.distance:.2f} mm and turns by {motion.angle_deg:.2f} degrees")

# %%
# The deformed mesh, coloured by how far each point has moved.

grid = answer.grid()
grid["moved [mm]"] = np.linalg.norm(answer.displacement, axis=1)
plotter = pv.Plotter(window_size=(900, 600))
plotter.add_mesh(grid.clip("x", origin=(0.0, 0.0, 0.0)), scalars="moved [mm]", show_edges=True,
                 scalar_bar_args={"vertical": True})
placed = scene.probe.points + np.array([0.0, back - 4.0, 0.0])
probe = pv.PolyData.from_regular_faces(placed, scene.probe.triangles)
plotter.add_mesh(probe, color="steelblue", opacity=0.6)
plotter.view_vector((1.0, 0.35, -0.25), viewup=(0.0, 1.0, 0.0))
plotter.show()

# %%
# **Check.** What the probe exerts on the skin and what the skin exerts on the probe add up to nothing, and the nodes of
# a vertebra keep their distances to each other, since it is rigid.

pushed = answer.contact.forces.sum(axis=0)
assert np.linalg.norm(pushed + answer.force) < 1e-9 * np.linalg.norm(pushed)

edges = mesh.edges[mesh.edge_part > 0]
moved = mesh.points + answer.displacement
rest, now = (np.linalg.norm(np.diff(points[edges], axis=1), axis=2) for points in (mesh.points, moved))
print(f"longest change of an edge inside a vertebra: {np.abs(now - rest).max():.1e} mm")
assert np.abs(now - rest).max() < 1e-4  # fields are stored in single precision
