"""
The phantom in twenty lines
===========================

A label map is meshed, and a probe presses on the back. Nothing is needed but the package: the anatomy is the built-in
phantom.
"""
# sphinx_gallery_thumbnail_number = 1

from dataclasses import replace

import numpy as np
import pyvista as pv

from mixpinn.anatomy import tiny_phantom
from mixpinn.dataset import TINY, grid_positions, plan_poses, probe_path
from mixpinn.fem import Scene, simulate_pose
from mixpinn.geometry.probe_shapes import linear_probe
from mixpinn.stages.mesh import MeshConfig, make_mesh

mesh = make_mesh(tiny_phantom(), MeshConfig(size=4.0)).mesh
scene = Scene(mesh, linear_probe(length=40.0))
protocol = replace(TINY, rotations=(0.0,), max_positions=1)
positions = grid_positions(mesh, protocol)
(pose,) = plan_poses(positions, protocol, mesh=mesh, probe=scene.probe, gap=scene.contact.gap)
path = probe_path(pose.position, pose.rotation_deg, protocol)
answer = simulate_pose(scene, path, position_index=0, rotation_deg=0.0)
print(f"{mesh.n_points} nodes; at {path.depths[-1]:g} mm the skin pushes back with {answer.probe_wrench[-1, 1]:.2f} N")

# %%
# The deformed mesh, coloured by how far each point has moved.

grid = mesh.grid(answer.displacement[-1])
grid["moved [mm]"] = np.linalg.norm(answer.displacement[-1], axis=1)
plotter = pv.Plotter(window_size=(900, 600))
plotter.add_mesh(grid.clip("x", origin=(0.0, 0.0, 0.0)), scalars="moved [mm]", show_edges=True)
plotter.add_mesh(pv.PolyData.from_regular_faces(
    scene.probe.points @ path.rotations[-1].T + path.translations[-1], scene.probe.triangles,
), color="steelblue", opacity=0.6)
plotter.view_vector((1.0, 0.35, -0.25), viewup=(0.0, 1.0, 0.0))
plotter.show()

# %%
# **Check.** What the probe exerts on the skin and what the skin exerts on the probe add up to nothing, and the nodes of
# a vertebra keep their distances to each other, since it is rigid.

_, forces = answer.contacts(len(path) - 1)
imbalance = np.linalg.norm(forces.sum(axis=0) + answer.probe_wrench[-1, :3])
assert imbalance < 1e-9 * np.linalg.norm(forces.sum(axis=0))

edges = mesh.edges[mesh.edge_part > 0]
moved = mesh.points + answer.displacement[-1]
rest, now = (np.linalg.norm(np.diff(points[edges], axis=1), axis=2) for points in (mesh.points, moved))
print(f"longest change of an edge inside a vertebra: {np.abs(now - rest).max():.1e} mm")
assert np.abs(now - rest).max() < 1e-4  # fields are stored in single precision
