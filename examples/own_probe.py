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
# The face is a circular arc of radius 60 mm in the plane x-y, 30 mm wide along x, extruded by 12 mm along z.

x = np.linspace(-15.0, 15.0, 21)
arc = np.column_stack([x, 60.0 - np.sqrt(60.0**2 - x**2)])
outline = np.vstack([arc, [[15.0, 25.0], [-15.0, 25.0]]])
shape = pv.PolyData(np.column_stack([outline, np.full(len(outline), -6.0)]), faces=[len(outline), *range(len(outline))])
solid = shape.triangulate().extrude((0.0, 0.0, 12.0), capping=True).triangulate().subdivide(1).clean()
probe = mx.Probe(np.asarray(solid.points, dtype=float), solid.regular_faces.astype(np.int64), "convex probe")

mesh = mx.make_mesh(tiny_phantom(), size=4.0)
scene = mx.Scene(mesh, probe)
tip = (0.0, mesh.points[:, 1].max() - 3.0, 0.0)
first, second = (mx.solve_pose(scene, tip=tip, rotation_deg=angle) for angle in (0.0, 180.0))

plotter = pv.Plotter(window_size=(700, 500))
plotter.add_mesh(solid, color="steelblue", show_edges=True)
plotter.view_vector((0.6, -0.6, 0.8), viewup=(0.0, 1.0, 0.0))
plotter.show()

# %%
# **Check.** Half a turn about its axis carries this probe into itself, so that it presses in the same way: the fields
# differ by no more than rounding and the solver's tolerance let them.

apart = np.abs(first.displacement - second.displacement).max()
print(f"force {first.force[1]:.3f} N; half a turn changes the field by {apart:.1e} mm")
assert apart < 1e-5
