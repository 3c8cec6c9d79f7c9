"""
One's own probe
===============

A probe is a triangle surface in millimetres, tip at the origin, pointing to −y. It may come from an STL file
(``Probe.load("probe.stl")``) or, as here, from a few lines of code: a convex probe, part of a cylinder.
"""

from dataclasses import replace

import numpy as np
import pyvista as pv

from mixpinn.anatomy import tiny_phantom
from mixpinn.dataset import TINY, grid_positions, plan_poses, probe_path
from mixpinn.fem import Scene, simulate_pose
from mixpinn.records import Probe
from mixpinn.stages.mesh import MeshConfig, make_mesh

# %%
# The face is a circular arc of radius 60 mm in the plane x-y, 30 mm wide along x, extruded by 12 mm along z.

x = np.linspace(-15.0, 15.0, 21)
arc = np.column_stack([x, 60.0 - np.sqrt(60.0**2 - x**2)])
outline = np.vstack([arc, [[15.0, 25.0], [-15.0, 25.0]]])
shape = pv.PolyData(np.column_stack([outline, np.full(len(outline), -6.0)]), faces=[len(outline), *range(len(outline))])
solid = shape.triangulate().extrude((0.0, 0.0, 12.0), capping=True).triangulate().subdivide(1).clean()
probe = Probe(np.asarray(solid.points, dtype=float), solid.regular_faces.astype(np.int64), "convex probe")

mesh = make_mesh(tiny_phantom(), MeshConfig(size=4.0)).mesh
scene = Scene(mesh, probe)
protocol = replace(TINY, rotations=(0.0, 180.0), max_positions=1)
poses = plan_poses(grid_positions(mesh, protocol), protocol, mesh=mesh, probe=probe, gap=scene.contact.gap)
first, second = (
    simulate_pose(
        scene, probe_path(pose.position, pose.rotation_deg, protocol), position_index=0, rotation_deg=pose.rotation_deg,
    )
    for pose in poses
)

plotter = pv.Plotter(window_size=(700, 500))
plotter.add_mesh(solid, color="steelblue", show_edges=True)
plotter.view_vector((0.6, -0.6, 0.8), viewup=(0.0, 1.0, 0.0))
plotter.show()

# %%
# **Check.** Half a turn about its axis carries this probe into itself, so that it presses in the same way: the fields
# differ by no more than rounding and the solver's tolerance let them.

apart = np.abs(first.displacement[-1] - second.displacement[-1]).max()
print(f"force {first.probe_wrench[-1, 1]:.3f} N; half a turn changes the field by {apart:.1e} mm")
assert apart < 1e-5
