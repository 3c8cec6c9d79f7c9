"""
One's own anatomy
=================

Nothing is special about five vertebrae. The anatomy here is a block of tissue with one ball of bone inside, written as
two NIfTI masks, read back and meshed like a patient's.
"""

import tempfile
from pathlib import Path

import nibabel as nib
import numpy as np
import pyvista as pv

import mixpinn as mx

# %%
# One mask a structure, on one grid, with the affine that says where the grid lies in the scanner (RAS, mm).

voxel, radius = 3.0, 15.0
centres = [voxel * (np.arange(count) + 0.5) for count in (36, 30, 40)]
x, y, z = np.meshgrid(*centres, indexing="ij")
inside = (x > 9.0) & (x < 99.0) & (y > 9.0) & (y < 81.0)
ball = (x - 54.0) ** 2 + (y - 39.0) ** 2 + (z - 60.0) ** 2 < radius**2

folder = Path(tempfile.mkdtemp())
for name, mask in {"body": inside, "ball": ball}.items():
    nib.save(nib.Nifti1Image(mask.astype(np.uint8), np.diag([voxel, voxel, voxel, 1.0])), folder / f"{name}.nii.gz")

# %%
# The folder is read with the ball as the one rigid part, cropped about it, and meshed.

labels = mx.load_anatomy(folder, body="body", rigid=("ball",))
mesh = mx.make_mesh(labels, size=2.0)
print(f"{mesh.n_points} nodes, rigid parts: {mesh.rigid_names}")

plotter = pv.Plotter(window_size=(700, 500))
plotter.add_mesh(mesh.grid().clip("x"), scalars="part", show_edges=True, cmap=["bisque", "ivory"],
                 show_scalar_bar=False)
plotter.show()

# %%
# **Check.** The tetrahedra fill the block less the ball: the block has the volume of its voxels, and (4/3) π r³ is
# missing. Surfaces are smoothed, which rounds the block's edges; two per cent are allowed for it.

block = np.count_nonzero(labels.labels) * voxel**3
expected = block - 4.0 / 3.0 * np.pi * radius**3
volume = mesh.cell_volumes.sum()
print(f"volume {volume / 1e3:.1f} ml, expected {expected / 1e3:.1f} ml")
assert abs(volume / expected - 1.0) < 0.02
# Bone is a cavity whose wall belongs to the ball: its nodes lie on a sphere.
wall = mesh.points[mesh.part == 1]
assert np.abs(np.linalg.norm(wall - wall.mean(axis=0), axis=1) - radius).max() < voxel
