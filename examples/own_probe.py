"""
One's own probe
===============

A probe is a triangle surface in millimetres, tip at the origin, pointing to −y. It may come from an STL file
(``mx.Probe.load("probe.stl")``) or, as here, from a few lines of code: a convex probe, part of a cylinder.
"""

import numpy as np
import pyvista as pv

import mixpinn as mx
from mixpinn.anatomy import tiny_phantom

# %%
# The face is a circular arc of radius 60 mm in the plane x-y, 30 mm wide along x and 12 mm long along z: a grid of
# points, and two triangles a square. An open surface will do where only its face can touch.

columns, rows = 21, 11
x, z = np.meshgrid(np.linspace(-15.0, 15.0, columns), np.linspace(-6.0, 6.0, rows), indexing="ij")
points = np.column_stack([x.ravel(), (60.0 - np.sqrt(60.0**2 - x**2)).ravel(), z.ravel()])
index = np.arange(columns * rows).reshape(columns, rows)
corners = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1).reshape(-1, 4)
triangles = np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])
probe = mx.Probe(points, triangles, "convex probe")

mesh = mx.make_mesh(tiny_phantom(), size=4.0)
scene = mx.Scene(mesh, probe)
tip = (0.0, mesh.points[:, 1].max() - 3.0, 0.0)
first, second = (mx.solve_pose(scene, tip=tip, rotation_deg=angle) for angle in (0.0, 180.0))

plotter = pv.Plotter(window_size=(700, 500))
plotter.add_mesh(pv.PolyData.from_regular_faces(points, triangles), color="steelblue", show_edges=True)
plotter.view_vector((0.6, -0.6, 0.8), viewup=(0.0, 1.0, 0.0))
plotter.show()

# %%
# **Check.** Half a turn about its axis carries this probe into itself, triangles included, so that it presses in the
# same way: the fields differ by no more than rounding and the solver's tolerance let them.

apart = np.abs(first.displacement - second.displacement).max()
print(f"force {first.force[1]:.3f} N; half a turn changes the field by {apart:.1e} mm")
assert apart < 1e-5
