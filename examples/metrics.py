"""
What the metrics measure
========================

The errors of the paper's tables, computed on fields for which the answer is known: a body that turns as a whole.
"""

import matplotlib.pyplot as plt
import numpy as np

import mixpinn as mx
from mixpinn.anatomy import tiny_phantom
from mixpinn.evaluation import MetricGeometry, sample_metrics
from mixpinn.geometry.rotations import rotation_from_vector

mesh = mx.make_mesh(tiny_phantom(), size=4.0)
geometry = MetricGeometry.of(mesh)
nothing = np.zeros((mesh.n_points, 3))

# %%
# **A shift.** Every node moves by (3, −4, 12) mm, a length of 13 mm. Predicting nothing is then wrong by 13 mm at each
# node (MEE), by (3 + 4 + 12)/3 mm a component (MAE) and by 13²/3 mm² (MSE).

shift = np.broadcast_to([3.0, -4.0, 12.0], (mesh.n_points, 3))
found = sample_metrics(nothing, shift, geometry)
print({name: round(float(value), 6) for name, value in found.items()})
assert np.isclose(found["mee"], 13.0)
assert np.isclose(found["mae"], 19.0 / 3.0)
assert np.isclose(found["mse"], 169.0 / 3.0)

# %%
# **A turn.** The rigid edge error (REE) asks whether vertebrae keep their shape: for a turn by any angle it is zero to
# rounding, while the linearised turn u = w × x lengthens every edge that it moves, at second order.

for degrees in (1.0, 90.0):
    vector = np.deg2rad(degrees) * np.array([2.0, -1.0, 2.0]) / 3.0
    turned = mesh.points @ rotation_from_vector(vector).T - mesh.points
    assert sample_metrics(turned, nothing, geometry)["ree"] < 1e-12

angles = np.array([1.0, 2.0, 4.0, 8.0])
small = np.deg2rad(1.0) * np.array([2.0, -1.0, 2.0]) / 3.0
stretch = [float(sample_metrics(np.cross(a * small, mesh.points), nothing, geometry)["ree"]) for a in angles]
print(f"linearised turns of 1 and 2 degrees: REE {stretch[0]:.2e} and {stretch[1]:.2e} mm")
assert abs(stretch[1] / stretch[0] - 4.0) < 0.01

figure, axes = plt.subplots(figsize=(5.0, 3.5), layout="constrained")
axes.loglog(angles, stretch, "o-", base=2)
axes.set(xlabel="angle of a linearised turn [degree]", ylabel="REE [mm]")
