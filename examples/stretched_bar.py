"""
A bar in tension: the solver against a closed form
==================================================

A bar is stretched by a half and left free at its sides. For a Neo-Hookean material the lateral stretch follows from
P₂₂ = 0, which is one equation in one unknown; the finite elements must find the same, since the deformation is
uniform.
"""

import numpy as np
import pyvista as pv
from scipy.optimize import brentq

from mixpinn.fem import ElasticSystem, SolverConfig, StableNeoHookean, solve_imposed
from mixpinn.mesh import orient_cells
from mixpinn.records import TissueMesh

# %%
# A mesh need not come from a label map: points, cells and labels are enough.

length, width, stretch = 40.0, 20.0, 1.5
box = pv.ImageData(dimensions=(9, 5, 5), spacing=(length / 8, width / 4, width / 4)).to_tetrahedra(5)
points = np.array(box.points, dtype=float)
cells = orient_cells(points, box.cells_dict[pv.CellType.TETRA])
nothing = np.zeros(len(points))
mesh = TissueMesh(
    points, cells.astype(np.int32), nothing.astype(np.int16), nothing.astype(bool), (),
    np.zeros(len(cells), dtype=np.int16),
)

tissue = StableNeoHookean.from_young(25.4e-3, 0.45)  # [N/mm²]


def lateral_stress(lateral: float) -> float:
    """P₂₂ of a bar stretched by `stretch` along x and by `lateral` across [N/mm²]."""
    return float(tissue.gradient(np.diag([stretch, lateral, lateral])[None])[0, 1, 1])


lateral = brentq(lateral_stress, 0.5, 1.0)
gradient = np.diag([stretch, lateral, lateral])
expected = points @ (gradient - np.eye(3))

# %%
# The nodes of both ends are moved there in ten steps; the solver finds where everything between them goes.

ends = np.flatnonzero((points[:, 0] == 0.0) | (points[:, 0] == length))
solution = solve_imposed(
    ElasticSystem(mesh, [tissue]), [(ends, share * expected[ends]) for share in np.linspace(0.1, 1.0, 10)],
    config=SolverConfig(tolerance=1e-10),
)
plotter = pv.Plotter(window_size=(900, 350))
plotter.add_mesh(mesh.grid(), style="wireframe", color="grey")
plotter.add_mesh(mesh.grid(solution.displacement[-1]), color="salmon", show_edges=True, opacity=0.8)
plotter.view_xy()
plotter.show()

# %%
# **Check.** Displacement and pulling force are those of the closed form; the force is the stress P₁₁ times the area at
# rest.

force = solution.gradient[-1, points[:, 0] == length, 0].sum()
closed_form = tissue.gradient(gradient[None])[0, 0, 0] * width**2
print(f"lateral stretch {lateral:.4f}; force {force:.6f} N, closed form {closed_form:.6f} N")
assert np.abs(solution.displacement[-1] - expected).max() < 1e-7
assert abs(force / closed_form - 1.0) < 1e-8
